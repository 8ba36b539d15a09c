"""Messages of a clearance meter, and what cannot be used."""

import math

import pytest
from sensor_msgs.msg import NavSatStatus, Range

from isogal.scenario import Altimeter
from isogal_ros.messages.altimeter import AltimeterAdapter
from isogal_ros.messages.checks import BadMessageError

READ = AltimeterAdapter(Altimeter()).read_raw


def distance(value, low=0.0, high=1000.0, variance=0.0):
    return Range(
        range=float(value), min_range=float(low), max_range=float(high), variance=float(variance)
    )


def test_zero_variance_is_an_unknown_one() -> None:
    assert READ(distance(100.0))[1] is None


@pytest.mark.parametrize(
    ("value", "low"),
    [(math.inf, 0.0), (-math.inf, 0.0), (1000.5, 0.0), (4.9, 5.0), (-1.0, 0.0)],
)
def test_out_of_range_is_no_reading_and_no_fault(value, low) -> None:
    assert math.isnan(READ(distance(value, low))[0])


def test_the_ends_of_the_range_are_in_it() -> None:
    assert [READ(distance(x, 5.0, 1000.0))[0] for x in (5.0, 1000.0)] == [5.0, 1000.0]


@pytest.mark.parametrize(("message", "words"), [
    (distance(math.nan), "not a number"),
    (distance(10.0, 10.0, 10.0), "fixed distance"),
    (distance(10.0, 20.0, 5.0), "min_range 20 m is not below max_range 5 m"),
    (distance(10.0, math.nan, 5.0), "is not below"),
    (distance(10.0, variance=-1.0), "negative variance"),
    (distance(10.0, variance=math.nan), "variance is not finite"),
])  # fmt: skip
def test_ranges_that_cannot_be_used(message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        READ(message)


def test_nothing_in_range_is_infinity_then_no_altitude() -> None:
    adapter = AltimeterAdapter(Altimeter(max_range=700.0))
    raw, reduced = adapter.new_raw(), adapter.new_reduced()
    adapter.fill_raw(raw, 0, math.nan, 1.0)
    assert (raw.range, raw.max_range) == (math.inf, 700.0)
    adapter.fill_reduced(reduced, 0, math.nan, 1.0, None)
    assert reduced.status.status == NavSatStatus.STATUS_NO_FIX
    assert math.isnan(adapter.read_reduced(reduced)[0])
    reduced.status.status = NavSatStatus.STATUS_FIX  # says it has one
    with pytest.raises(BadMessageError, match="not finite"):
        adapter.read_reduced(reduced)
