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


@pytest.mark.parametrize("value", [0.0, -9.8, 4.9, 20.1, 9.8e5])
def test_gravity_that_is_not_the_earths_is_refused(value) -> None:
    """Zero and the other sign were once left to the matcher, which left them out in silence."""
    adapter = GravimeterAdapter(topics.GRAVITY)
    message = adapter.new_raw()
    adapter.fill_raw(message, 1, value, 1e-10)
    for read in (adapter.read_raw, adapter.read_reduced):
        with pytest.raises(BadMessageError, match="not the Earth's"):
            read(message)
    adapter.fill_raw(message, 1, 9.8, 1e-10)
    assert adapter.read_raw(message) == (9.8, 1e-10)
