"""The filter of many runs: updates against filterpy, consistency, refusals."""

import numpy as np
import pytest
from scipy.stats import chi2

from helpers.navigators import SIGMA, error_between, filterpy_update, fly, random_covariance
from isogal.fusion.model import FilterModel
from isogal.fusion.navigator import (
    FilterDivergenceError,
    propagate,
    update_information,
    update_position,
    widen,
)
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import (
    BATCH,
    HORIZONTAL_STATES,
    batch_covariance,
)
from isogal.scenario import Imu, Route, Scenario
from isogal.seeds import generator

SCALE = SIGMA * SIGMA[:, None]
HORIZONTAL = BATCH[:HORIZONTAL_STATES]
MODEL = FilterModel.from_scenario(Scenario())


def with_covariance(seed=0):
    state = fly().start
    state.covariance[0] = random_covariance(SIGMA, seed)
    return state


def test_errors_agree_with_their_covariance():
    """Normalised squared errors of 60 flights of half an hour with a fix every 5 min: chi-square,
    99.9 %."""
    runs = 60
    flight = fly(range(runs), route=Route(duration=1800.0))
    state, random = flight.start, np.random.default_rng(8)
    R = np.array([[90.0**2, 2000.0], [2000.0, 60.0**2]])
    keep = np.array(
        [0, 1, 3, 4, 6, 7, 8, 9, 10, 12, 13, 14]
    )  # the vertical channel is aided better than assumed
    fix_nis = []
    for stamp in range(300, 1801, 300):
        part = slice(stamp - 300, stamp)
        force, rate = flight.imu.specific_force[:, part], flight.imu.angular_rate[:, part]
        propagate(
            state, flight.model, force, rate, flight.trajectory.height[stamp - 299 : stamp + 1]
        )
        for run in range(runs if stamp < 1800 else 0):
            fix = flight.fix(stamp, *(np.linalg.cholesky(R) @ random.standard_normal(2)))
            fix_nis.append(update_position(state, flight.model, run, *fix, R)[1])
    trajectory = flight.trajectory
    sensors = Scenario().imu.sensors
    sigma = np.array([*sensors.accelerometer.bias, *sensors.gyroscope.bias])
    bias = np.array(
        [sigma * generator(0, run, "imu_bias").standard_normal(6) for run in range(runs)]
    )
    truth = FilterState(
        np.tile([trajectory.latitude[-1], trajectory.longitude[-1], 100.0], (runs, 1)),
        np.tile(trajectory.velocity[-1], (runs, 1)), np.tile(trajectory.attitude[-1], (runs, 1)),
        bias[:, :3], bias[:, 3:], np.zeros((runs, 0)), state.covariance,
        np.zeros(runs), np.zeros((runs, 2)),
    )  # fmt: skip
    errors = np.array([error_between(state, truth, run)[keep] for run in range(runs)])
    covariances = state.covariance[:, keep[:, None], keep]
    total = np.einsum("ri,ri->", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])
    low, high = chi2.ppf([0.0005, 0.9995], len(keep) * runs)
    assert low < total < high, total / (len(keep) * runs)
    low, high = chi2.ppf([0.0005, 0.9995], 2 * len(fix_nis))
    assert low < np.sum(fix_nis) < high, np.mean(fix_nis) / 2.0


@pytest.mark.parametrize("grade", ["precision", "quantum"])
def test_covariance_stays_symmetric_positive_definite_through_hours(grade):
    flight = fly(route=Route(), imu=Imu(grade=grade))
    state = flight.start
    for stamp in range(0, len(flight.trajectory), 1620):
        part = slice(stamp, stamp + 1620)
        force, rate = flight.imu.specific_force[:, part], flight.imu.angular_rate[:, part]
        propagate(
            state, flight.model, force, rate, flight.trajectory.height[stamp + 1 : stamp + 1621]
        )
        covariance = state.covariance[0]
        assert (covariance == covariance.T).all()
        deviation = np.sqrt(np.diag(covariance))
        assert np.linalg.eigvalsh(covariance / deviation / deviation[:, None])[0] > 1e-9
        # a fix to the metre after kilometres: the hardest update for positive definiteness
        perfect = flight.fix(stamp + 1620, 0.0, 0.0)
        update_position(state, flight.model, 0, *perfect, np.eye(2))
        np.linalg.cholesky(state.covariance[0])
    assert flight.trajectory.time[-1] == 3.6 * 3600.0


def test_a_covariance_that_is_not_positive_definite_is_reported():
    flight = fly(range(3))
    state = flight.start
    state.covariance[1, 0, 1] = state.covariance[1, 1, 0] = 2.0 * state.covariance[1, 0, 0]
    force, rate = flight.imu.specific_force[:, :5], flight.imu.angular_rate[:, :5]
    with pytest.raises(
        FilterDivergenceError, match=r"covariance of run\(s\) \[1\] is not positive definite"
    ):
        propagate(state, flight.model, force, rate, flight.trajectory.height[1:6])
    assert np.linalg.eigvalsh(state.covariance[1])[0] < 0.0
    force = force.copy()
    force[2, 1, 0] = np.nan
    state.covariance[1] = state.covariance[0]
    with pytest.raises(FilterDivergenceError, match=r"run\(s\) \[2\]"):
        propagate(state, flight.model, force, rate, flight.trajectory.height[1:6])


@pytest.mark.parametrize("states", [HORIZONTAL, BATCH], ids=["horizontal", "with attitude"])
@pytest.mark.parametrize("rank", [1, 2, 4])
def test_information_update_equals_filterpy(rank, states):
    random = np.random.default_rng(rank)
    state = with_covariance()
    before = state.copy()
    H = random.standard_normal((rank, len(states))) / SIGMA[states]
    z = random.standard_normal(rank)  # unit noise
    correction, nis = update_information(state, 0, H.T @ z, H.T @ H)
    full = np.zeros((rank, 15))
    full[:, states] = H
    xi, covariance = filterpy_update(
        before.covariance[0], full, np.eye(rank), z
    )  # the error, estimate minus truth
    np.testing.assert_allclose(state.covariance[0] / SCALE, covariance / SCALE, atol=1e-9)
    np.testing.assert_allclose(error_between(state, before) / SIGMA, -xi / SIGMA, atol=1e-7)
    np.testing.assert_allclose(correction / SIGMA[states], -xi[states] / SIGMA[states], atol=1e-9)
    S = full @ before.covariance[0] @ full.T + np.eye(rank)
    assert nis == pytest.approx(z @ np.linalg.solve(S, z), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_negative_information_makes_less_certain(seed):
    """Of a posterior wider than the prior in some directions: mean and covariance of (position,
    velocity) become the posterior's."""
    random = np.random.default_rng(seed)
    state = with_covariance(seed)
    before = state.copy()
    prior = before.covariance[0][np.ix_(HORIZONTAL, HORIZONTAL)]
    factor = np.linalg.cholesky(prior)
    axes = factor @ np.linalg.qr(random.standard_normal((4, 4)))[0]
    wanted = (axes * [0.1, 0.8, 1.5, 3.5]) @ axes.T
    mean = factor @ random.standard_normal(4)
    inverse = np.linalg.inv(wanted)
    correction, nis = update_information(state, 0, inverse @ mean, inverse - np.linalg.inv(prior))
    scale = SIGMA[HORIZONTAL]
    got = state.covariance[0][np.ix_(HORIZONTAL, HORIZONTAL)]
    np.testing.assert_allclose(
        got / scale / scale[:, None], wanted / scale / scale[:, None], atol=1e-8
    )
    np.testing.assert_allclose(correction / scale, -mean / scale, atol=1e-7)
    assert (np.linalg.eigvalsh(state.covariance[0] / SCALE) > 0.0).all()
    assert nis >= 0.0


def test_negative_information_is_bounded():
    """Nothing becomes more than twice as uncertain, though a navigator may know less by now than
    when the batch was matched."""
    state = with_covariance()
    prior = state.covariance[0][np.ix_(HORIZONTAL, HORIZONTAL)]
    update_information(state, 0, np.zeros(4), -1.2 * np.linalg.inv(prior))
    got = state.covariance[0][np.ix_(HORIZONTAL, HORIZONTAL)]
    scale = SIGMA[HORIZONTAL]
    np.testing.assert_allclose(
        got / scale / scale[:, None], 4.0 * prior / scale / scale[:, None], atol=1e-8
    )


BAD = np.diag([1.0, 1.0, 1.0, -1e6])


def with_position(latitude, covariance):
    return lambda state: update_position(state, MODEL, 0, latitude, 0.0, covariance)


def with_information(vector, matrix):
    return lambda state: update_information(state, 0, vector, matrix)


@pytest.mark.parametrize(
    ("update", "message"),
    [
        (with_position(np.nan, np.eye(2)), "fix is not finite"),
        (with_position(0.0, np.full((2, 2), np.inf)), "fix is not finite"),
        (with_position(0.0, np.array([[1.0, 2.0], [2.0, 1.0]])), "not positive definite"),
        (with_position(0.0, -np.eye(2)), "not positive definite"),
        (with_information(np.full(4, np.nan), np.eye(4)), "information is not finite"),
        (with_information(np.ones(4), BAD), "too negative"),
    ],
)
def test_updates_that_cannot_be_used_change_nothing(update, message):
    state = with_covariance()
    before = state.copy()
    with pytest.raises(ValueError, match=message):
        update(state)
    for array, old in zip(state.arrays(), before.arrays(), strict=True):
        assert (array == old).all()


def test_a_lost_run_is_widened_alone():
    state = fly(range(2)).start
    before = state.copy()
    widen(state, 1, batch_covariance(30e3, 0.5, 1e-4, 0.0))
    assert (state.covariance[0] == before.covariance[0]).all()
    change = np.sqrt(np.diag(state.covariance[1] - before.covariance[1]))
    np.testing.assert_allclose(
        change, [30e3, 30e3, 0, 0.5, 0.5, 0, 1e-4, 1e-4, *[0] * 7], rtol=1e-9
    )
