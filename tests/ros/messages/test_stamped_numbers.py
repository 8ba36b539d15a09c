"""Arrays of numbers with a stamp, and what cannot be used."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

from helpers.navigators import random_covariance
from isogal.passage import Aided, Passage
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamped_numbers import (
    fill_nav_covariance,
    fill_numbers,
    peek_numbers_ns,
    read_nav_covariance,
)


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_stamp(ns) -> None:
    message = Float64MultiArray()
    fill_numbers(message, ns, np.eye(7))
    assert peek_numbers_ns(serialize_message(message)) == ns


def test_numbers_without_a_stamp_are_refused() -> None:
    for data in ([], [1.0], [float("nan"), 0.0, 1.0], [1.0, -5.0, 0.0], [1e300, 0.0]):
        with pytest.raises(BadMessageError, match=r"numbers|stamp"):
            peek_numbers_ns(serialize_message(Float64MultiArray(data=data)))


@pytest.mark.parametrize("size", [4, 7])
def test_nav_covariance(size) -> None:
    message = Float64MultiArray()
    cov = random_covariance(np.ones(size), 1)
    fill_numbers(message, 12_500_000_000, cov)
    assert list(message.data[:2]) == [12.0, 500_000_000.0]
    found, aided = read_nav_covariance(message)
    np.testing.assert_array_equal(found, cov)
    assert aided is None


def test_nav_covariance_with_what_satellites_have_told() -> None:
    message = Float64MultiArray()
    cov, without = (random_covariance(np.ones(7), seed) for seed in (1, 2))
    told = Aided(7.25, without, np.arange(7.0))
    fill_nav_covariance(message, 12_500_000_000, cov, told)
    assert peek_numbers_ns(serialize_message(message)) == 12_500_000_000
    found, aided = read_nav_covariance(message)
    np.testing.assert_array_equal(found, cov)
    assert isinstance(aided, Aided)
    assert aided.begin == told.begin
    np.testing.assert_array_equal(aided.covariance, without)
    np.testing.assert_array_equal(aided.jump, told.jump)
    message.data[-1] = float("nan")
    with pytest.raises(BadMessageError, match="not finite"):
        read_nav_covariance(message)


def test_nav_covariance_with_a_passage() -> None:
    message = Float64MultiArray()
    n, random = 9, np.random.default_rng(3)
    before, smoothed, after = (random_covariance(np.ones(n), seed) for seed in (1, 2, 3))
    cross, mean, two = random.random((n, n)), random.random(n), random.random(2)
    told = Passage(7.25, before, mean, smoothed, cross, after, two, random.random((2, n - 7)))
    fill_nav_covariance(message, 12_500_000_000, after[:7, :7], told)
    covariance, found = read_nav_covariance(message)
    np.testing.assert_array_equal(covariance, after[:7, :7])
    assert isinstance(found, Passage)
    assert found.begin == told.begin
    for one, other in zip(found.arrays, told.arrays, strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(BadMessageError, match="no passage"):
        read_nav_covariance(Float64MultiArray(data=message.data[:-1]))


def test_messages_that_cannot_be_used() -> None:
    with pytest.raises(BadMessageError, match="7 x 7 or 4 x 4"):
        read_nav_covariance(Float64MultiArray(data=[0.0] * 20))
