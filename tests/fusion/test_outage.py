"""What is still known after a time without inertial data."""

import numpy as np
import pytest

from helpers.navigators import ROUTE, error_between, fly
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.earth.frames import horizontal_difference
from isogal.fusion.assumed import UNKNOWN_GRAVITY
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import PositionFix
from isogal.fusion.outage import (
    HELD,
    MANOEUVRE,
    UnknownMotion,
    keep_going,
    outage_covariance,
    steady_sample,
)

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 900.0}))


@pytest.mark.parametrize("seconds", [0.0, 1.0, 30.0, 600.0, 3600.0])
def test_growth(seconds) -> None:
    """Of a constant acceleration while it is short, and never faster than the vehicle."""
    P = outage_covariance(seconds, 20.0, UnknownMotion(0.1, 1e-3))
    assert np.linalg.eigvalsh(P).min() > -1e-9 * max(P.max(), 1.0)
    sigma = np.sqrt(np.diag(P))
    assert sigma[3] <= 20.0
    assert sigma[0] == pytest.approx(sigma[3] * seconds / 2.0)
    if seconds <= 30.0:
        assert sigma[3] == pytest.approx(0.1 * seconds, rel=0.02)
        assert sigma[8] == pytest.approx(1e-3 * seconds)
    assert sigma[8] <= 0.5


def test_a_manoeuvre_ends() -> None:
    """In a gap of three times as long as a manoeuvre lasts, at a time that is uniform in it: by
    simulation."""
    motion = UnknownMotion(0.02, 0.0).seen((np.zeros(3), np.zeros(3)), manoeuvre=True)
    assert motion.lasts == MANOEUVRE
    rng = np.random.default_rng(1)
    change = 0.02 * MANOEUVRE * rng.standard_normal(100_000)
    begun = rng.uniform(0.0, 2.0 * MANOEUVRE, change.size)
    moved = change * (3.0 * MANOEUVRE - begun - 0.5 * MANOEUVRE)
    P = outage_covariance(3.0 * MANOEUVRE, 1e3, motion)
    np.testing.assert_allclose(P[np.ix_([0, 3], [0, 3])], np.cov(moved, change), rtol=0.02)


def test_samples_at_either_side_say_how_steady_the_vehicle_was() -> None:
    nothing, unknown = np.zeros(3), UnknownMotion()
    steady = unknown.seen((nothing, nothing), manoeuvre=False)
    assert (steady.acceleration, steady.turn_rate, steady.tilt) == (0.0, 0.0, 0.0)
    turning = (np.array([0.0, 0.3, 0.0]), np.array([0.0, 0.0, 0.02]))
    seen = unknown.seen(turning, manoeuvre=False)
    assert (seen.acceleration, seen.turn_rate) == (0.3, 0.02)
    inside = unknown.seen((nothing, nothing), manoeuvre=True)
    assert (inside.acceleration, inside.turn_rate) == (0.1, 1e-3)
    # after the time between manoeuvres one has come with 1 - 1/e
    without, one = unknown.log_probabilities(600.0)
    assert np.exp(one) == pytest.approx(1.0 - np.exp(-1.0))
    assert np.exp(without) + np.exp(one) == pytest.approx(1.0)


def test_a_steady_vehicle_is_where_it_would_be() -> None:
    state = FLIGHT.start.copy()
    before = state.velocity.copy()
    keep_going(state, FLIGHT.model, 600.0, 100.0)
    speed = np.hypot(*before[:2])
    np.testing.assert_allclose(state.velocity[:2], before[:2], atol=0.02 * speed)
    truth = FLIGHT.trajectory
    assert abs(state.position[0] - truth.latitude[600]) < 1e-4  # 600 m in 12 km


def test_steady_sample_has_the_biases() -> None:
    state = FLIGHT.start.copy()
    force, rate = steady_sample(state)
    assert np.linalg.norm(force) == pytest.approx(9.8, abs=0.03)
    assert np.linalg.norm(rate) < 1e-4
    state.accelerometer_bias[:], state.gyroscope_bias[:] = [0.1, 0.2, 0.3], [1e-3, 0.0, 0.0]
    biased = steady_sample(state)
    np.testing.assert_allclose(biased[0] - force, [0.1, 0.2, 0.3], atol=1e-12)
    np.testing.assert_allclose(biased[1] - rate, [1e-3, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("gap", [0, 3, 8, 60, 600])
def test_a_gap_widens_the_filter_and_is_replayed_for_a_late_fix(gap) -> None:
    ends = []
    for late in (False, True):
        it = InertialNavigator(FLIGHT.model, FLIGHT.start)
        fix = FLIGHT.fix(50, 20.0, -10.0)
        for k in [*range(100), *range(100 + gap, 130 + gap)]:
            missing = float(gap) if k == 100 + gap else 0.0
            it.imu(k + 1.0, *FLIGHT.samples(k, k + 1), missing)
            if k + 1 == (120 + gap if late else 50):
                assert it.measure(50.0, PositionFix(*fix, 400.0 * np.eye(2))).used
        ends.append(it.state)
    assert np.abs(error_between(*ends)).max() < 1e-12
    sigma = np.sqrt(np.diag(ends[0].covariance))
    change = tuple(part[100 + gap] - part[99] for part in (FLIGHT.force, FLIGHT.rate))
    motion = UnknownMotion().seen(change, manoeuvre=gap > HELD)
    added = np.sqrt(np.diag(outage_covariance(float(gap), ROUTE.speed, motion)))
    assert sigma[0] >= added[0]
    # with the height known the vertical force tells the east velocity by its Eötvös term, as well
    # as unknown gravity lets it in the 30 s since
    eotvos = 2.0 * EARTH_RATE * np.cos(ends[0].position[0])
    told = UNKNOWN_GRAVITY / np.sqrt(30.0) / eotvos
    assert sigma[4] >= 0.98 / np.hypot(1.0 / max(added[4], 1e-9), 1.0 / told)
    truth = FLIGHT.fix(130 + gap, 0.0, 0.0)
    off = horizontal_difference(*ends[0].position[:2], *truth)
    assert np.hypot(*off) < 3.0 * np.hypot(*sigma[:2])
    assert (gap > HELD) == (gap >= 60)
