"""Prediction by the filter: consistency, positive definiteness, failures."""

import numpy as np
import pytest

from helpers.navigators import assert_close, error_between, fly, identical
from helpers.statistics import within_chi_square
from isogal.fusion.measurements import HeightReading, PositionFix
from isogal.fusion.prediction import FilterDivergenceError, propagate
from isogal.scenario import Height, Imu, Route, Scenario, Velocity
from isogal.seeds import generator


def test_errors_agree_with_their_covariance():
    """Normalised squared errors of 60 flights of half an hour with a fix every 5 min: chi-square,
    99.9 %."""
    runs, random = 60, np.random.default_rng(8)
    R = np.array([[90.0**2, 2000.0], [2000.0, 60.0**2]])
    # the vertical channel is aided better than assumed
    keep = np.array([0, 1, 3, 4, 6, 7, 8, 9, 10, 12, 13, 14])
    sensors = Scenario().imu.sensors
    sigma = np.array([*sensors.accelerometer.bias, *sensors.gyroscope.bias])
    fix_nis, total = [], 0.0
    for run in range(runs):
        flight = fly(run, route=Route(duration=1800.0))
        state, truth = flight.start, flight.trajectory
        for stamp in range(300, 1801, 300):
            propagate(state, flight.model, *flight.samples(stamp - 300, stamp))
            if stamp < 1800:
                fix = flight.fix(stamp, *(np.linalg.cholesky(R) @ random.standard_normal(2)))
                fix_nis.append(PositionFix(*fix, R).update(state, flight.model).nis)
        bias = sigma * generator(0, run, "imu_bias").standard_normal(6)
        true = state.copy()
        true.position[:] = truth.latitude[-1], truth.longitude[-1], 100.0
        true.velocity[:], true.attitude[:] = truth.velocity[-1], truth.attitude[-1]
        true.accelerometer_bias[:], true.gyroscope_bias[:] = bias[:3], bias[3:]
        error = error_between(state, true)[keep]
        total += error @ np.linalg.solve(state.covariance[np.ix_(keep, keep)], error)
    assert within_chi_square(total, len(keep) * runs), total / (len(keep) * runs)
    assert within_chi_square(np.sum(fix_nis), 2 * len(fix_nis)), np.mean(fix_nis) / 2.0


@pytest.mark.parametrize("grade", ["precision", "quantum"])
def test_covariance_stays_symmetric_positive_definite_through_hours(grade):
    flight = fly(route=Route(), imu=Imu(grade=grade))
    state = flight.start
    for stamp in range(0, len(flight.trajectory), 1620):
        propagate(state, flight.model, *flight.samples(stamp, stamp + 1620))
        covariance = state.covariance
        assert (covariance == covariance.T).all()
        deviation = np.sqrt(np.diag(covariance))
        assert np.linalg.eigvalsh(covariance / deviation / deviation[:, None])[0] > 1e-9
        # a fix to the metre after kilometres: the hardest update for positive definiteness
        PositionFix(*flight.fix(stamp + 1620, 0.0, 0.0), np.eye(2)).update(state, flight.model)
        np.linalg.cholesky(state.covariance)
    assert flight.trajectory.time[-1] == 3.6 * 3600.0


@pytest.mark.parametrize("filter_", ["compiled", "reference"])
def test_a_covariance_that_is_not_positive_definite_is_reported(filter_):
    flight = fly(fusion={"filter": filter_})
    state = flight.start.copy()
    state.covariance[0, 1] = state.covariance[1, 0] = 2.0 * state.covariance[0, 0]
    with pytest.raises(FilterDivergenceError, match="not positive definite"):
        propagate(state, flight.model, *flight.samples(0, 5))
    flight.force[1, 0] = np.nan
    with pytest.raises(FilterDivergenceError, match="not positive definite"):
        propagate(flight.start, flight.model, *flight.samples(0, 5))


BAROMETER = Height(source="barometer", bias=6.0, scale=0.02, weather_sigma=4.0)
LOG = Velocity(kind="dvl", current_sigma=0.3)


@pytest.mark.parametrize("filter_", ["compiled", "reference"])
def test_heights_with_the_inertial_data_equal_readings_of_their_own(filter_):
    """Propagation with a reading at its end against propagation without, then the reading."""
    flight = fly(height=BAROMETER, velocity=LOG, fusion={"filter": filter_})
    force, rate, _ = flight.samples(0, 3)
    inside, after = flight.start.copy(), flight.start.copy()
    propagate(inside, flight.model, force, rate, np.array([np.nan, np.nan, 107.0]))
    propagate(after, flight.model, force, rate, np.full(3, np.nan))
    HeightReading(107.0, BAROMETER.sigma**2).update(after, flight.model)
    assert_close(inside, after, 1e-6, 1e-7)
    # beyond the gate, once the height is known
    wrong, without = inside.copy(), inside.copy()
    propagate(wrong, flight.model, force[:1], rate[:1], np.array([10e3]))
    propagate(without, flight.model, force[:1], rate[:1], np.array([np.nan]))
    assert identical(wrong, without)


def test_a_known_height_passes_whatever_it_is():
    flight = fly()
    force, rate, _ = flight.samples(0, 1)
    propagate(flight.start, flight.model, force, rate, np.array([10e3]))
    assert flight.start.position[2] > 1e3
