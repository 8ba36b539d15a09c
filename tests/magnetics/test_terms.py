"""The terms of the model, against the field of an aircraft built by hand and by other means."""

import numpy as np

from helpers.magnetics import INTENSITY, aircraft, fly, identifiable
from isogal.magnetics.aircraft import MagneticAircraft
from isogal.magnetics.manoeuvres import calibration_flight, ordinary_flight
from isogal.magnetics.terms import COUNT, SCALE, names, terms


def test_columns_in_the_order_and_scale_of_the_literature():
    # Gnadt et al. 2022, by hand for one reading
    vector, rate, total = np.array([3.0e4, 0.0, 4.0e4]), np.array([10.0, 20.0, 30.0]), 5.0e4
    row = terms(vector[None], rate[None], np.array([total]), np.array([[2.0]]))[0]
    u = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(row[:3], u)
    np.testing.assert_allclose(row[3:9], np.array([0.36, 0.0, 0.48, 0.0, 0.0, 0.64]) * 1.0)
    np.testing.assert_allclose(row[9:18], np.outer(u, rate).ravel() / SCALE)
    np.testing.assert_allclose(row[18:], 2.0 * u)
    assert len(names(("strobe",))) == len(row) == COUNT + 3


def test_the_model_is_the_aircraft_to_first_order():
    craft = aircraft(size=0.1)  # 20 nT: what is of second order is below 0.02 nT
    flight = ordinary_flight(1, minutes=2.0)
    readings, total = fly(flight, craft)
    predicted = readings.terms() @ craft.coefficients()
    added = readings.total - total
    assert np.ptp(added) > 5.0
    np.testing.assert_allclose(predicted, added, atol=0.5)  # noise of 0.1 nT


def test_what_a_flight_does_not_tell_is_constant_or_nothing():
    readings, _ = fly(calibration_flight(), MagneticAircraft())
    coefficients = np.zeros(COUNT)
    coefficients[[3, 6, 8]] = 40.0
    np.testing.assert_allclose(readings.terms() @ coefficients, 40.0 * INTENSITY / SCALE, atol=0.1)
    coefficients = np.zeros(COUNT)
    coefficients[[9, 13, 17]] = 40.0
    assert np.abs(readings.terms() @ coefficients).max() < 0.1
    np.testing.assert_allclose(identifiable(coefficients), 0.0, atol=1e-12)
