"""Calibration flights of an aircraft built by hand, and what is left of it on another flight."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from helpers.magnetics import BAD_SENSOR, INTENSITY, STROBE, Circumstances, aircraft, fly, spread
from isogal.errors import InputError
from isogal.evaluation.calibration_report import by_heading
from isogal.magnetics.band_pass import Band
from isogal.magnetics.calibration import Settings, calibrate
from isogal.magnetics.manoeuvres import Flight, calibration_flight, ordinary_flight
from isogal.magnetics.readings import Readings

NO_LAG = Settings(lag=0.0)


@lru_cache
def flown():
    """Readings of a calibration flight, and the total field there."""
    return fly(calibration_flight(), aircraft(), Circumstances(noise=0.02))


def calibrated(readings, **settings):
    """What is found where the field is known but for a constant."""
    known = np.full(len(readings), INTENSITY)
    return calibrate(readings, known, replace(NO_LAG, **settings))


@lru_cache
def clean():
    return calibrated(flown()[0])


@lru_cache
def other_flight():
    return fly(ordinary_flight(3), aircraft(), Circumstances(noise=0.02), seed=2)


def test_a_heading_error_of_200_nt_is_gone_on_another_flight():
    readings, total = other_flight()
    heading = ordinary_flight(3).angles[:, 2]
    before, after = readings.total - total, clean().compensation.clean(readings) - total
    assert np.ptp(before) > 190.0
    assert spread(after) < 0.5
    assert spread(by_heading(heading, before)) > 25.0
    assert spread(by_heading(heading, after)) < 0.5
    means = by_heading(np.array([0.0, 6.2, np.pi / 2.0, np.pi]), np.array([1.0, 3.0, 5.0, np.nan]))
    assert (means[0], means[2]) == (2.0, 5.0) and np.isnan(means[4])
    assert clean().rms_after < 0.05
    assert clean().rms_before > 5.0


def test_switched_currents_a_poor_vector_sensor_and_a_diurnal():
    around = Circumstances(diurnal=40.0, errors=BAD_SENSOR, strobe=True)
    craft = aircraft(size=2.2)
    readings, _ = fly(calibration_flight(), craft, around)
    found = calibrated(readings).compensation
    readings, total = fly(ordinary_flight(3), craft, around, seed=2)
    assert np.ptp(readings.total - total) > 400.0
    assert spread(found.clean(readings) - total) < 5.0
    np.testing.assert_allclose(found.coefficients[18:], STROBE, atol=0.3)  # in its axes


def test_the_lag_of_the_vector_magnetometer_is_found():
    around = Circumstances(lag=0.2, noise=0.02)
    readings, _ = fly(calibration_flight(rate=5.0), aircraft(), around)
    found = calibrated(readings, lag=None).compensation
    assert found.lag == pytest.approx(0.2, abs=0.01)


def test_an_offset_is_told_by_a_reference_only():
    readings, total = flown()
    found = calibrate(readings, total, NO_LAG, reference=True).compensation
    assert np.nanmean(found.clean(readings) - total) == pytest.approx(0.0, abs=0.1)
    assert clean().compensation.offset == 0.0


def straight():
    flight = ordinary_flight(5, minutes=5.0)
    return replace(flight, angles=np.zeros_like(flight.angles))


def first(count):
    flight = calibration_flight()
    parts = flight.time, flight.angles, flight.north, flight.east
    return Flight(*(part[:count] for part in parts))


@pytest.mark.parametrize(
    ("flight", "said"),
    [
        (straight(), "no calibration manoeuvres"),
        (first(1000), "on one heading only"),
        (first(150), "no stretch"),
        (calibration_flight(rate=0.3), "too far apart"),
    ],
)
def test_flights_that_are_no_calibration_are_refused(flight, said):
    readings, _ = fly(flight, aircraft())
    with pytest.raises(InputError, match=said):
        calibrate(readings, settings=NO_LAG)


def test_small_swings_are_taken_by_force_for_what_they_tell():
    flight = calibration_flight()
    flight = replace(flight, angles=flight.angles * [0.04, 0.04, 1.0])
    readings, _ = fly(flight, aircraft(), Circumstances(noise=0.02))
    with pytest.raises(InputError, match="--force"):
        calibrated(readings)
    found = calibrated(readings, force=True)
    assert found.determined < clean().determined - 1.0
    wrong = (found.compensation.coefficients - aircraft().coefficients())[:9]
    sigma, usual = found.compensation.sigma[:9], clean().compensation.sigma[:9]
    assert 0.1 < np.mean((wrong / sigma) ** 2) < 3.0
    assert np.abs(wrong[2]) > 100.0  # the field's component that hardly moved
    assert sigma[2] > 50.0 > 5.0 * usual[2]


def test_readings_in_another_unit_and_what_is_no_band_are_refused():
    for total, vector in ((5e-5, 5e-5), (5e4, 5e-5), (5e4, 2e4)):
        with pytest.raises(InputError, match="are not the Earth's field in nT"):
            Readings(np.arange(5.0), np.full(5, total), np.outer(np.ones(5), [0, 0, vector]), "f")
    with pytest.raises(InputError, match="band"):
        Band(0.9, 0.1)
