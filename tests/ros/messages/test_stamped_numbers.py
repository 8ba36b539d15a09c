"""Arrays of numbers with a stamp, and what cannot be used."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

from helpers.navigators import random_covariance
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamped_numbers import (
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
        with pytest.raises(ValueError, match=r"numbers|stamp"):
            peek_numbers_ns(serialize_message(Float64MultiArray(data=data)))


@pytest.mark.parametrize("size", [4, 7])
def test_nav_covariance(size) -> None:
    message = Float64MultiArray()
    cov = random_covariance(np.ones(size), 1)
    fill_numbers(message, 12_500_000_000, cov)
    assert list(message.data[:2]) == [12.0, 500_000_000.0]
    np.testing.assert_array_equal(read_nav_covariance(message), cov)


def test_messages_that_cannot_be_used() -> None:
    with pytest.raises(BadMessageError, match="7 x 7 or 4 x 4"):
        read_nav_covariance(Float64MultiArray(data=[0.0] * 20))
