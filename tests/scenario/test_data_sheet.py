"""Numbers with the units of data sheets."""

import math

import pytest

from isogal.scenario.data_sheet import G
from isogal.scenario.inertial import (
    ANGLE,
    FORCE,
    FORCE_NOISE,
    RATE,
    RATE_BY_FORCE,
    RATE_NOISE,
    RATIO,
    TIME,
)

DEG = math.pi / 180.0


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (FORCE, "50 µg", 50e-6 * 9.80665),  # micro sign
        (FORCE, "50 μg", 50e-6 * 9.80665),  # Greek letter
        (FORCE, "3e-4 m/s^2", 3e-4),
        (FORCE, "3e-4m/s²", 3e-4),
        (FORCE, 2, 2.0),
        (FORCE_NOISE, "30 ug/√Hz", 30e-6 * 9.80665),
        (FORCE_NOISE, "30ug/sqrt(Hz)", 30e-6 * 9.80665),
        (FORCE_NOISE, "0.065 ft/s/√h", 0.065 * 0.3048 / 60.0),
        (RATE, "0.01 °/hr", 0.01 * DEG / 3600.0),
        (RATE_NOISE, "0.002deg/rt-h", 0.002 * DEG / 60.0),
        (RATE_BY_FORCE, "0.1deg/h/g", 0.1 * DEG / 3600.0 / 9.80665),
        (RATIO, "300ppm", 3e-4),
        (ANGLE, "1mrad", 1e-3),
        (ANGLE, "20arcsec", 20.0 * DEG / 3600.0),
        (TIME, "1h", 3600.0),
    ],
)
def test_units_of_data_sheets(kind, text, value):
    assert kind.read(text) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("kind", "value", "says"),
    [
        (RATE, "5ug", "'ug' is not a unit of this key; give a number (rad/s) or a text like 0.01"),
        (FORCE, "50uT", "unknown unit 'uT'"),
        (FORCE, "ug", "must be a number (m/s²) or a text like 50ug, not 'ug'"),
        (FORCE, "-50ug", "must not be negative or infinite"),
        (FORCE, math.nan, "must not be negative or infinite"),
        (FORCE, True, "must be a number"),
        (TIME, "0s", "must not be zero"),
    ],
)
def test_what_is_no_such_number_says_what_may_be_given(kind, value, says):
    with pytest.raises(ValueError) as caught:
        kind.read(value)
    assert says in str(caught.value)


def test_one_value_or_one_per_axis():
    assert FORCE.read_axes("1mg") == (1e-3 * G,) * 3
    assert FORCE.read_axes(["1mg", 2.0, "3"]) == (1e-3 * G, 2.0, 3.0)
    assert FORCE.read_axes(None) is None
    with pytest.raises(ValueError, match="one value, or three"):
        FORCE.read_axes([1.0, 2.0])
