"""Coefficients learnt while flying, from a cold start."""

import numpy as np

from helpers.magnetics import BAD_SENSOR, INTENSITY, Circumstances, aircraft, fly, spread
from isogal.magnetics.compensation import Compensation
from isogal.magnetics.manoeuvres import ordinary_flight
from isogal.magnetics.online import Assumed, RecursiveCompensation


def learn(learner: RecursiveCompensation, readings, every: int = 1):
    own = np.full((len(learner.state), len(readings)), np.nan)
    sigma = own.copy()
    runs = len(learner.state)
    for i in range(0, len(readings), every):
        vector, total = np.tile(readings.vector[i], (runs, 1)), np.full(runs, readings.total[i])
        own[:, i], sigma[:, i] = learner.step(readings.time[i], vector, total, INTENSITY)
    return own, sigma


def test_cold_start():
    around = Circumstances(errors=BAD_SENSOR)
    readings, total = fly(ordinary_flight(3, minutes=14.0, rate=5.0), aircraft(), around)
    own, sigma = learn(RecursiveCompensation(), readings)
    error = readings.total - own[0] - total
    late = readings.time > 600.0
    assert np.ptp(readings.total[late] - total[late]) > 150.0
    assert spread(error[late]) < 10.0
    assert np.sqrt(np.nanmean(error[late] ** 2)) < 10.0
    assert np.nanmean((error[late] / sigma[0, late]) ** 2) < 1.0  # it knows how little it knows


def test_a_calibrated_start_is_good_at_once():
    craft = aircraft()
    readings, total = fly(ordinary_flight(4, minutes=3.0, rate=5.0), craft)
    known = craft.coefficients()
    start = Compensation(known, sigma=np.full(known.size, 2.0))
    own, _ = learn(RecursiveCompensation(Assumed(offset_sigma=2.0), start), readings)
    assert spread((readings.total - own[0] - total)[100:]) < 8.0
    cold, _ = learn(RecursiveCompensation(), readings)
    assert spread((readings.total - cold[0] - total)[100:]) > 12.0


def test_runs_do_not_depend_on_each_other_and_missing_readings_change_nothing():
    readings, _ = fly(ordinary_flight(4, minutes=0.5, rate=5.0), aircraft())
    one, three = RecursiveCompensation(), RecursiveCompensation(runs=3)
    single, several = learn(one, readings)[0], learn(three, readings)[0]
    np.testing.assert_allclose(several, np.repeat(single, 3, axis=0), rtol=1e-12)
    before = one.coefficients.copy()
    own, sigma = one.step(1000.0, np.full((1, 3), np.nan), np.array([5e4]))
    assert np.isnan(own).all()
    assert np.isnan(sigma).all()
    np.testing.assert_array_equal(one.coefficients, before)


def test_walking_coefficients_stay_uncertain():
    readings, _ = fly(ordinary_flight(4, minutes=1.0, rate=5.0), aircraft())
    still, walking = (RecursiveCompensation(Assumed(walk=walk)) for walk in (0.0, 5.0))
    learn(still, readings)
    learn(walking, readings)
    assert (walking.compensation().sigma >= still.compensation().sigma).all()
