"""Messages of a gravimeter, and what cannot be used."""

import math

import pytest

from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.gravimeter import GravimeterAdapter
from isogal_ros.messages.position import NOT_MEASURED

ADAPTER = GravimeterAdapter(topics.GRAVITY)


def test_only_the_vertical_is_measured() -> None:
    message = ADAPTER.new_raw()
    ADAPTER.fill_raw(message, 3, 9.80665, 1e-10)
    assert ADAPTER.read_raw(message) == (9.80665, 1e-10)
    assert message.header.frame_id == "gravimeter_link"
    assert message.accel.covariance[0] == NOT_MEASURED


@pytest.mark.parametrize(
    ("value", "variance", "words"),
    [(9.8, -1.0, "negative variance"), (math.nan, 1.0, "not finite")],
)
def test_readings_that_cannot_be_used(value, variance, words) -> None:
    message = ADAPTER.new_raw()
    ADAPTER.fill_raw(message, 0, value, variance)
    with pytest.raises(BadMessageError, match=words):
        ADAPTER.read_raw(message)


def test_another_frame_is_refused() -> None:
    message = ADAPTER.new_raw()
    message.header.frame_id = "base_link"
    with pytest.raises(BadMessageError, match="frame_id must be 'gravimeter_link'"):
        ADAPTER.read_raw(message)
