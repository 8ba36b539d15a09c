"""The low-pass filter and the delay of an instrument."""

import numpy as np
import pytest
from scipy.signal import lsim, lti

from isogal.scenario import Gravimeter
from isogal.sensors.lag import Lag, low_pass


def test_a_delay_alone_reads_what_was():
    time = np.arange(0.0, 101.0)
    signal = np.sin(time / 7.0)
    lag = Lag(delay=12.5, filter_time=0.0)
    read = lag.report(time, signal, np.array([5.0, 12.5, 40.0]))
    assert np.isnan(read[0])
    np.testing.assert_allclose(read[1:], np.interp([0.0, 27.5], time, signal))


def test_the_filter_is_that_of_scipy():
    time = np.arange(0.0, 600.0)
    signal = np.sin(time / 40.0) + 0.3 * np.cos(time / 9.0)
    signal -= signal[0]
    _, expected, _ = lsim(lti([1.0], [25.0, 1.0]), signal, time)
    np.testing.assert_allclose(low_pass(signal, 1.0, 25.0), expected, atol=1e-12)


def test_it_starts_settled_and_leaves_what_does_not_change():
    np.testing.assert_allclose(low_pass(np.full((2, 50), 3.0), 1.0, 10.0), 3.0)
    np.testing.assert_array_equal(low_pass(np.arange(5.0), 1.0, 0.0), np.arange(5.0))


def test_readings_are_given_once_the_filter_has_settled():
    time = np.arange(0.0, 201.0)
    read = Lag(delay=5.0, filter_time=10.0).report(time, time, np.array([44.0, 45.0, 200.0]))
    assert np.isnan(read[0])
    # of a ramp: the mean age is the delay and the time constant
    assert read[2] == pytest.approx(200.0 - 15.0, abs=1e-6)


def test_ages_stand_for_the_filter():
    lag = Lag(delay=8.0, filter_time=20.0)
    ages, weight = lag.ages()
    assert weight.sum() == pytest.approx(1.0)
    assert ages @ weight == pytest.approx(lag.mean)
    # a sine of 4 km at 22 m/s: damped and late by the filter's transfer function
    frequency = 2.0 * np.pi * 22.0 / 4000.0
    response = np.exp(-1j * frequency * ages) @ weight
    expected = np.exp(-1j * frequency * 8.0) / (1.0 + 1j * frequency * 20.0)
    assert abs(response - expected) < 1e-3


def test_that_of_an_instrument():
    assert Lag.of(Gravimeter()).mean == 0.0
    assert Lag.of(Gravimeter(delay=20.0, filter_time=5.0)) == (20.0, 5.0)
