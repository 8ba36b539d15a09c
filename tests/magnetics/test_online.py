"""Coefficients learnt while flying, from a cold start."""

from dataclasses import replace

import numpy as np

from helpers.magnetics import BAD_SENSOR, INTENSITY, Circumstances, aircraft, fly, spread
from isogal.magnetics.compensation import Compensation
from isogal.magnetics.manoeuvres import ordinary_flight
from isogal.magnetics.online import learn_along


def learnt(readings, start=None, **keys):
    return learn_along(readings, np.full(len(readings), INTENSITY), start, **keys)


def test_cold_start():
    around = Circumstances(errors=BAD_SENSOR)
    readings, total = fly(ordinary_flight(3, minutes=14.0, rate=5.0), aircraft(), around)
    found = learnt(readings)
    error = readings.total - found.own - total
    late = readings.time > 600.0
    assert np.ptp(readings.total[late] - total[late]) > 150.0
    assert spread(error[late]) < 10.0
    assert np.sqrt(np.nanmean(error[late] ** 2)) < 10.0
    # it knows how little it knows
    assert np.nanmean((error[late] / found.sigma[late]) ** 2) < 1.0


def test_a_calibrated_start_is_good_at_once():
    craft = aircraft()
    readings, total = fly(ordinary_flight(4, minutes=3.0, rate=5.0), craft)
    known = craft.coefficients()
    start = Compensation(known, sigma=np.full(known.size, 2.0))
    for found, least, most in (
        (learnt(readings, start, offset_sigma=2.0), 0.0, 8.0),
        (learnt(readings), 12.0, np.inf),
    ):
        assert least < spread((readings.total - found.own - total)[100:]) < most


def test_missing_readings_change_nothing():
    readings, _ = fly(ordinary_flight(4, minutes=0.5, rate=5.0), aircraft())
    rows = slice(0, 100)
    first = replace(
        readings,
        time=readings.time[rows],
        total=readings.total[rows],
        vector=readings.vector[rows],
    )
    total = readings.total.copy()
    total[100:] = np.nan
    alone, gone = learnt(first), learnt(replace(readings, total=total))
    np.testing.assert_array_equal(gone.own[rows], alone.own)
    assert np.isnan(gone.own[100:]).all()
    assert np.isnan(gone.sigma[100:]).all()
    np.testing.assert_array_equal(gone.compensation.coefficients, alone.compensation.coefficients)
    unknown = np.where(np.arange(len(readings)) < 100, INTENSITY, np.nan)
    of_map = learn_along(readings, unknown)
    np.testing.assert_allclose(
        of_map.compensation.coefficients, alone.compensation.coefficients, rtol=1e-9
    )
