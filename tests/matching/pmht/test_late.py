"""Late and filtered readings of the matcher: against SciPy's filter, finite differences and the
path itself."""

import numpy as np
import pytest

from isogal.matching.pmht.late import (
    SHORTEST,
    Late,
    believed,
    earlier,
    late_by,
    low_passed,
    shares,
)
from isogal.matching.pmht.rows import LONGEST, PAST
from isogal.matching.pmht.states import DELAY, FILTER, FILTER_ERROR, UNKNOWN
from isogal.sensors.lag import low_pass

INTERVAL, STATES = 10.0, 9
LATE = Late(value=7, error=8, delay=-1, lag=30.0)


def signal(time):
    """With periods of 3 and 8 min."""
    return np.sin(time / 30.0) + 0.5 * np.cos(time / 75.0)


def rate(time):
    return np.cos(time / 30.0) / 30.0 - 0.5 * np.sin(time / 75.0) / 75.0


def taken(time, lag, elapsed=INTERVAL):
    """What a filter takes in before times, and how that changes with its age."""
    _, age, spread = shares(lag, elapsed)
    ages = np.array([age - spread, age + spread])
    then = np.asarray(time)[..., None] - ages
    return signal(then).mean(axis=-1), -rate(then).mean(axis=-1)


@pytest.mark.parametrize("lag", [3.0, 30.0, 120.0])
def test_shares_are_moments_of_the_filter_s_weights(lag):
    age = np.linspace(0.0, INTERVAL, 200001)
    weight = np.exp(-age / lag) / lag
    total = np.trapezoid(weight, age)
    mean = np.trapezoid(weight * age, age) / total
    spread = np.sqrt(np.trapezoid(weight * (age - mean) ** 2, age) / total)
    np.testing.assert_allclose(shares(lag, INTERVAL), (1.0 - total, mean, spread), rtol=1e-6)


@pytest.mark.parametrize(("lag", "error"), [(30.0, 0.0), (30.0, -15.0), (10.0, 5.0), (120.0, 0.0)])
def test_a_filter_s_value_is_that_of_a_low_pass(lag, error):
    """Its error of 8 s or more has gone after ten time constants."""
    time = np.arange(0.0, 14.0 * lag, INTERVAL)
    late = Late(7, 8, -1, lag)
    x, P, work = np.zeros(STATES), np.zeros((STATES, STATES)), np.zeros(STATES)
    x[8] = error
    at = x.copy()
    for now in time[1:]:
        g, by_age = taken(now, lag + error)
        low_passed(x, P, late, at, INTERVAL, float(g), np.zeros(STATES), float(by_age), 9, work)
    fine = np.arange(0.0, time[-1] + 0.05, 0.1)
    assert x[7] == pytest.approx(low_pass(signal(fine), 0.1, lag + error)[-1], abs=2e-3)
    other = low_pass(signal(fine), 0.1, 1.3 * (lag + error))[-1]
    assert abs(x[7] - other) > 0.01


def test_its_covariance_is_that_of_finite_differences():
    random = np.random.default_rng(7)
    G = np.r_[random.normal(size=7), 0.0, 0.0]
    root = random.normal(size=(STATES, STATES))
    P0, mean, error = root @ root.T, random.normal(size=STATES), 2.0
    mean[8] = error

    def value(state):
        """The filter's value after 10 s, of a time constant that is wrong by the last state."""
        lag = LATE.lag + state[8]
        left, (g, _) = np.exp(-INTERVAL / lag), taken(500.0, lag)
        return left * state[7] + (1.0 - left) * (g + G @ state)

    step = 1e-5 * np.eye(STATES)
    slope = np.array([value(mean + s) - value(mean - s) for s in step]) / 2e-5
    F = np.eye(STATES)
    F[7] = slope
    g, by_age = taken(500.0, LATE.lag + error)
    x, P = mean.copy(), P0.copy()
    low_passed(x, P, LATE, mean, INTERVAL, float(g), G, float(by_age), STATES, np.zeros(STATES))
    assert x[7] == pytest.approx(value(mean), rel=1e-12)
    np.testing.assert_allclose(P, F @ P0 @ F.T, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(np.delete(x, 7), np.delete(mean, 7))


def test_a_time_constant_stays_positive():
    at = np.zeros(STATES)
    assert believed(LATE, at) == 30.0
    at[8] = -40.0
    assert believed(LATE, at) == SHORTEST * 30.0
    assert believed(LATE._replace(error=-1), at) == 30.0


def test_the_past_is_linear_between_its_points_and_goes_on_beyond_them():
    past = np.zeros((1, 3, 3))
    past[0, 1:] = [1.0, 2.0, 3.0], [1.5, 2.0, 2.0]
    np.testing.assert_allclose(earlier(past, 0, 0.5 * PAST)[:3], [0.5, 1.0, 1.5])
    np.testing.assert_allclose(earlier(past, 0, 1.5 * PAST)[:3], [1.25, 2.0, 2.5])
    np.testing.assert_allclose(earlier(past, 0, 3.0 * PAST)[:3], [2.0, 2.0, 1.0])
    np.testing.assert_allclose(earlier(past, 0, -PAST)[:3], [-1.0, -2.0, -3.0])
    np.testing.assert_allclose(earlier(past, 0, 1.5 * PAST)[3:], np.r_[0.5, 0.0, -1.0] / PAST)


def test_readings_at_rest_are_filtered_all_the_same():
    """Where the past is known, and the vehicle has not moved: not where it is not known."""
    count = 8 + len(UNKNOWN)
    used, unknown = np.arange(count), count - len(UNKNOWN)
    at_rest = late_by(used, count, count, 30.0, np.zeros((3, LONGEST, 3)))
    assert at_rest == (unknown + FILTER, unknown + FILTER_ERROR, unknown + DELAY, 30.0)
    assert late_by(used, count, count, 30.0, np.zeros((3, 2, 3))) == (-1, -1, -1, 30.0)
