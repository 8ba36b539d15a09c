"""Positions as messages, and what cannot be used."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import NavSatFix, NavSatStatus

from helpers.navigators import random_covariance
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.position import fill_fix, read_covariance, read_position


@given(st.floats(-1.5, 1.5), st.floats(-3.14, 3.14), st.floats(-100.0, 1e4), st.integers(0, 99))
def test_both_ways(latitude, longitude, height, seed) -> None:
    message = NavSatFix()
    message.header.frame_id = "base_link"
    cov = random_covariance(np.ones(3), seed)
    fill_fix(message, 5, latitude, longitude, height, cov)
    back = read_position(message)
    np.testing.assert_allclose(back, [latitude, longitude, height], rtol=4e-16, atol=1e-15)
    np.testing.assert_array_equal(read_covariance(message), cov)
    assert message.position_covariance[0] == cov[1, 1]  # east first
    assert message.position_covariance[4] == cov[0, 0]


def test_longitude_beyond_the_date_line() -> None:
    message = NavSatFix()
    fill_fix(message, 0, 0.0, math.radians(190.0), 0.0)
    assert message.longitude == pytest.approx(-170.0)
    assert message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"latitude": math.nan}, "not finite"),
        ({"latitude": 91.0}, "no such place"),
        ({"longitude": 400.0}, "no such place"),
        ({"position_covariance": np.diag([1.0, -1.0, 1.0]).ravel()}, "negative variance"),
        ({"position_covariance": np.full(9, math.nan)}, "not finite"),
        ({"position_covariance_type": NavSatFix.COVARIANCE_TYPE_UNKNOWN}, "not known"),
        ({"header.frame_id": "antenna"}, "frame_id must be"),
    ],
)
def test_fixes_that_cannot_be_used(change, words) -> None:
    message = NavSatFix(status=NavSatStatus(status=NavSatStatus.STATUS_FIX))
    message.header.frame_id = "base_link"
    message.position_covariance = np.eye(3).ravel()
    message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_KNOWN
    for name, value in change.items():
        target, _, last = name.rpartition(".")
        setattr(getattr(message, target) if target else message, last, value)
    with pytest.raises(BadMessageError, match=words):
        read_position(message)
        read_covariance(message)
