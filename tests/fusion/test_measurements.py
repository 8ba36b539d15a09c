"""Measurement models: against filterpy and differences; the gate; what cannot be used."""

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import chi2

from helpers.navigators import (
    ROUTE,
    SIGMA,
    error_between,
    fly,
    identical,
    random_covariance,
)
from isogal.fix import Fix, Information
from isogal.fusion.measurements import (
    GroundVelocity,
    HeadingReading,
    HeightReading,
    InformationUpdate,
    LearntMapError,
    Outcome,
    PositionFix,
    VelocityReading,
    Widening,
    measurements_of,
    position_fix,
    satellite_velocity,
)
from isogal.fusion.measurements.model import Rows, update_linear
from isogal.fusion.measurements.rest import AtRest
from isogal.fusion.measurements.trust import AGREEING, INSISTS
from isogal.fusion.model import FilterModel, quantile
from isogal.fusion.nominal import move
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import BATCH, HORIZONTAL_STATES, batch_covariance
from isogal.inertial.rotations import matrix
from isogal.scenario import Fusion, Gnss, HeadingAid, Height, Imu, Velocity

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 120.0}))
FAR = 78e3  # m
SCALE = SIGMA * SIGMA[:, None]
HORIZONTAL = BATCH[:HORIZONTAL_STATES]
BAROMETER = Height(source="barometer", bias=6.0, scale=0.02, weather_sigma=4.0)
LOG = Velocity(kind="dvl", current_sigma=0.3)
DVL = Velocity(kind="dvl", standstill_speed=0.1)


def open_model() -> FilterModel:
    """Without a gate."""
    return fly(fusion=Fusion(false_rejection=0.0)).model


def with_covariance(seed=0):
    state = FLIGHT.start.copy()
    state.covariance[:] = random_covariance(SIGMA, seed)
    return state


def horizontal(state) -> np.ndarray:
    return state.covariance[np.ix_(HORIZONTAL, HORIZONTAL)]


def assert_filterpy(before, state, H, R, z) -> np.ndarray:
    """What filterpy makes of a linear measurement is what has become of a state; returns the
    change."""
    kalman = KalmanFilter(dim_x=len(SIGMA), dim_z=len(R))
    kalman.P = before.covariance.copy()
    kalman.update(z[:, None], R=R, H=H)
    np.testing.assert_allclose(state.covariance / SCALE, kalman.P / SCALE, atol=1e-9)
    moved = error_between(state, before)
    np.testing.assert_allclose(moved / SIGMA, kalman.x[:, 0] / SIGMA, atol=1e-7)
    return kalman.x[:, 0]


@pytest.mark.parametrize(("rank", "states"), [(1, HORIZONTAL), (4, BATCH)])
def test_information_equals_filterpy(rank, states):
    random = np.random.default_rng(rank)
    state = with_covariance()
    before = state.copy()
    H = random.standard_normal((rank, len(states))) / SIGMA[states]
    z = random.standard_normal(rank)  # unit noise
    result = InformationUpdate(H.T @ z, H.T @ H).update(state, open_model())
    full = np.zeros((rank, 15))
    full[:, states] = H
    # told of the error, estimate minus truth
    change = assert_filterpy(before, state, full, np.eye(rank), -z)[:2]
    np.testing.assert_allclose(result.innovation / SIGMA[:2], change / SIGMA[:2], atol=1e-9)
    S = full @ before.covariance @ full.T + np.eye(rank)
    assert result.nis == pytest.approx(z @ np.linalg.solve(S, z), rel=1e-9)


def test_negative_information_makes_less_certain():
    """Of a posterior wider than the prior in some directions: mean and covariance of (position,
    velocity) become the posterior's. But nothing becomes more than twice as uncertain, though a
    navigator may know less by now than when the batch was matched."""
    random = np.random.default_rng(1)
    state = with_covariance(1)
    before = state.copy()
    prior = horizontal(before)
    factor = np.linalg.cholesky(prior)
    axes = factor @ np.linalg.qr(random.standard_normal((4, 4)))[0]
    wanted = (axes * [0.1, 0.8, 1.5, 3.5]) @ axes.T
    mean = factor @ random.standard_normal(4)
    inverse = np.linalg.inv(wanted)
    told = InformationUpdate(inverse @ mean, inverse - np.linalg.inv(prior))
    result = told.update(state, open_model())
    scale = SIGMA[HORIZONTAL]
    unlike = (horizontal(state) - wanted) / scale / scale[:, None]
    np.testing.assert_allclose(unlike, 0.0, atol=1e-8)
    moved = error_between(state, before)[HORIZONTAL]
    np.testing.assert_allclose(moved / scale, -mean / scale, atol=1e-6)
    assert (np.linalg.eigvalsh(state.covariance / SCALE) > 0.0).all()
    assert result.nis >= 0.0
    state = before.copy()
    InformationUpdate(np.zeros(4), -1.2 * np.linalg.inv(prior)).update(state, FLIGHT.model)
    np.testing.assert_allclose(horizontal(state) / prior, 4.0, rtol=1e-6)


def test_rows_equal_filterpy():
    state = with_covariance()
    before, random = state.copy(), np.random.default_rng(0)
    H = random.standard_normal((2, 15)) / SIGMA
    R, z = np.array([[1.0, 0.3], [0.3, 2.0]]), np.array([0.7, -1.2])
    result = update_linear(state, open_model(), Rows(z + 5.0, np.full(2, 5.0), H, R))
    assert_filterpy(before, state, H, R, z)
    S = H @ before.covariance @ H.T + R
    assert result.nis == pytest.approx(float(z @ np.linalg.solve(S, z)))
    np.testing.assert_allclose(result.measured, z + 5.0)


GNSS = Gnss(available=((0.0, 60.0),), lever_arm=(3.0, -1.0, -2.0))
HEADINGS = (
    HeadingAid(sigma=0.01),
    HeadingAid(name="mag", kind="compass"),
    HeadingAid(name="cog", kind="course", slowest=3.0),
)
PLACE = FLIGHT.start.position + np.array([2e-7, -1e-7, 3.0])
TURN = np.array([0.02, -0.05, 0.3])
LINEAR = {
    "position": ({"gnss": GNSS}, position_fix(GNSS.positions, PLACE, False)),
    "position and height": (
        {"gnss": GNSS, "height": BAROMETER},
        position_fix(GNSS.positions, PLACE, True),
    ),
    "velocity": ({"gnss": GNSS}, satellite_velocity(GNSS, np.array([5.0, 3.0, 0.1]), TURN)),
    "log": ({"velocity": LOG}, VelocityReading.of(LOG, np.array([20.0, 1.0, -0.5]))),
    **{
        one.kind: ({"headings": HEADINGS}, HeadingReading.of(one, 3.0, 2025.0)) for one in HEADINGS
    },
    "at rest": ({"imu": Imu(grade="tactical")}, AtRest(np.array([0.1, -0.2, -9.8]), TURN, 1.0)),
}
"""Settings of a filter, and a measurement."""


@pytest.mark.parametrize("name", LINEAR)
def test_rows_are_those_of_differences(name):
    """H is how much h changes with each state, of a tilted vehicle; lever arms, mounting, slow
    errors and currents included."""
    keys, measurement = LINEAR[name]
    model = fly(**keys).model
    state = FilterState.start(FLIGHT.start.estimate, model)
    state.auxiliary[:] = np.linspace(0.01, 0.05, len(state.auxiliary))
    move(state.nominal, np.array([*np.zeros(6), 0.2, -0.4, 0.9, *np.zeros(model.states - 9)]))
    H = measurement.rows(state, model).H
    # rates of a vehicle at rest are of 7e-5 rad/s, and places count on the ellipsoid
    atol = {"at rest": np.array([1e-5] * 3 + [1e-9] * 3), "log": 1e-5}.get(name, 1e-4)
    for column in range(model.states):
        step, ends = np.zeros(model.states), []
        for sign in (1.0, -1.0):
            moved = state.copy()
            step[column] = sign * 1e-3
            move(moved.nominal, step)
            rows = measurement.rows(moved, model)
            # of a position what is expected is relative to the estimate, and z with it
            ends.append(rows.expected - rows.measured)
        change = (ends[0] - ends[1]) / 2e-3
        assert (np.abs(change - H[:, column]) < atol).all(), column
    if name in [one.kind for one in HEADINGS]:
        assert abs((rows.measured - rows.expected)[0]) <= math.pi


@pytest.mark.parametrize(
    ("measurement", "message"),
    [
        (PositionFix(np.nan, 0.0, np.eye(2)), "fix is not finite"),
        (PositionFix(0.0, 0.0, np.full((2, 2), np.nan)), "not positive definite"),
        (PositionFix(0.0, 0.0, np.array([[1.0, 2.0], [2.0, 1.0]])), "not positive definite"),
        (InformationUpdate(np.full(4, np.nan), np.eye(4)), "information is not finite"),
        (HeightReading(np.nan, 1.0), "not finite"),
        (LearntMapError(0.0, 5e3), "map error"),
        (LearntMapError(1e-5, np.inf), "map error"),
    ],
)
def test_what_cannot_be_used_changes_nothing(measurement, message):
    state = with_covariance()
    before = state.copy()
    with pytest.raises(ValueError, match=message):
        measurement.update(state, FLIGHT.model)
    assert identical(state, before)


def test_widening_adds_to_a_batchs_states_alone():
    state, before = FLIGHT.start.copy(), FLIGHT.start
    assert Widening(batch_covariance(30e3, 0.5, 1e-4, 0.0)).update(state, FLIGHT.model).used
    change = np.sqrt(np.diag(state.covariance - before.covariance))
    expected = [30e3, 30e3, 0, 0.5, 0.5, 0, 1e-4, 1e-4, *[0] * 7]
    np.testing.assert_allclose(change, expected, rtol=1e-9)
    assert state.contradicted


# The gate


def sigma() -> float:
    return float(np.sqrt(FLIGHT.start.covariance[0, 0]))


def fix_away(metres: float, sigma: float = 1.0, whole: bool = False, **keys) -> Fix:
    """A fix to the north of the navigator's own place at the start."""
    place = FLIGHT.start.position.copy()
    M = np.diag([sigma**-2, sigma**-2, 0.0, 0.0])
    told = Information(M @ [-metres, 0.0, 0.0, 0.0], M) if whole else None
    place[0] += metres / 6.36e6
    return Fix(0.0, *place[:2], sigma**2 * np.eye(2), information=told, **keys)


def applied(fix: Fix, state, model=FLIGHT.model):
    return [one.update(state, model) for one in measurements_of(fix)][-1]


def test_the_gates_are_quantiles_of_chi_square():
    for k in range(1, 8):
        assert FLIGHT.model.gate(k) == pytest.approx(chi2.isf(1e-9, k), rel=1e-7)
    assert quantile(0.0, 2) == math.inf


@pytest.mark.parametrize("whole", [False, True], ids=["position", "information"])
def test_a_fix_78_km_off_is_rejected_unless_it_is_to_be_believed(whole):
    state = FLIGHT.start.copy()
    result = applied(fix_away(FAR, whole=whole), state)
    assert result.outcome is Outcome.REJECTED
    assert result.reason.startswith("78.")
    assert identical(state, FLIGHT.start)
    # without a gate, and where the matcher widens for it
    assert applied(fix_away(FAR, whole=whole), state, open_model()).nis > 1e5
    assert error_between(state, FLIGHT.start)[0] == pytest.approx(FAR, rel=0.01)
    state = FLIGHT.start.copy()
    assert applied(fix_away(FAR, 50.0, whole, reset=True), state).used
    assert error_between(state, FLIGHT.start)[0] == pytest.approx(FAR, rel=0.01)
    state = FLIGHT.start.copy()
    assert applied(fix_away(4.0 * sigma(), whole=whole), state).used
    assert not identical(state, FLIGHT.start)


def test_weak_information_is_judged_by_what_it_does():
    """A direction of which next to nothing is told implies a place far away."""
    tiny = 1e-8 / sigma() ** 2
    M = np.diag([tiny, tiny, 0.0, 0.0])
    told = Information(np.array([1e-3 / sigma(), 0.0, 0.0, 0.0]), M)
    state = FLIGHT.start.copy()
    result = applied(Fix(0.0, 0.0, 0.0, np.eye(2), information=told), state)
    assert result.used
    assert result.nis > FLIGHT.model.gate(4)
    assert np.hypot(*error_between(state, FLIGHT.start)[:2]) < 0.01 * sigma()


# Height


def test_one_reading_tells_the_height_to_the_size_of_its_errors():
    """Before it nothing is known: the height follows the reading, its errors are as assumed, and
    height and errors go together."""
    it = fly(height=BAROMETER)
    state = it.start
    assert state.covariance[2, 2] == 1000.0**2
    reading = HeightReading(112.0, BAROMETER.sigma**2)
    assert reading.update(state, it.model).used
    assert state.position[2] == pytest.approx(112.0, abs=0.01)
    size = np.sqrt(6.0**2 + 2.0**2 + 4.0**2 + 0.5**2)
    assert np.sqrt(state.covariance[2, 2]) == pytest.approx(size, rel=1e-3)
    # the next reading is expected where the first one was
    assert reading.update(state, it.model).nis < 0.1
    assert HeightReading(10e3, 0.25).update(state, it.model).outcome is Outcome.REJECTED


# Velocity


def dvl(velocity, settings=DVL, covariance=None) -> VelocityReading:
    reading = VelocityReading.of(settings, np.asarray(velocity, dtype=float), covariance)
    assert reading is not None
    return reading


def test_a_dvl_tells_the_velocity_and_knots_are_rejected():
    it = fly(velocity=DVL)
    state, model = it.start.copy(), it.model
    body = matrix(state.attitude).T @ it.trajectory.velocity[0]
    knots = dvl(body * 1.94384).update(state, model)
    assert knots.outcome is Outcome.REJECTED
    assert identical(state, it.start)
    share = np.linalg.norm(knots.measured) / np.linalg.norm(knots.expected)
    assert share == pytest.approx(1.944, abs=0.01)
    assert dvl(body).update(state, model).used
    before = it.start.covariance[4, 4]
    assert state.covariance[4, 4] < 0.64 * before
    assert VelocityReading.of(DVL, np.full(3, np.nan)) is None


def test_a_contradicted_aid_is_used_again_once_it_has_agreed_for_a_while():
    it = fly(velocity=DVL)
    state = it.start
    Widening(np.zeros((7, 7))).update(state, it.model)
    before = state.copy()
    forward = float(np.linalg.norm(state.velocity))
    right, wrong = dvl([forward, 0.0, 0.0]), dvl([forward + 2.0, 0.0, 0.0])
    for _ in range(AGREEING - 1):
        assert right.update(state, it.model).outcome is Outcome.UNTRUSTED
    assert wrong.update(state, it.model).outcome is Outcome.UNTRUSTED  # all is to be done again
    np.testing.assert_array_equal(state.velocity, before.velocity)
    np.testing.assert_array_equal(state.covariance, before.covariance)
    before.velocity[:] = 0.0
    assert dvl([0.0, 0.0, 0.0]).update(before, it.model).used  # a standstill is, at once
    outcomes = [right.update(state, it.model).outcome for _ in range(AGREEING)]
    assert outcomes == [Outcome.UNTRUSTED] * (AGREEING - 1) + [Outcome.USED]
    assert right.update(state, it.model).used


@pytest.mark.parametrize(("sigmas", "heard"), [(8.0, True), (20.0, False)])
def test_an_aid_that_insists_is_heard_unless_it_is_far_off(sigmas, heard):
    """A pressure of 8 m more for good was once refused for good."""
    it = fly(height=BAROMETER)
    state = it.start
    for _ in range(3):
        seen = HeightReading(100.0, 1.0).update(state, it.model)
    away = HeightReading(float(seen.expected[0]) + 100.0, 1.0).update(state.copy(), it.model)
    reading = HeightReading(float(seen.expected[0]) + 100.0 * sigmas / math.sqrt(away.nis), 1.0)
    before = state.copy()
    results = [reading.update(state, it.model) for _ in range(INSISTS)]
    assert not any(one.used for one in results[:-1])
    assert results[-1].used == heard
    assert (results[-1].nis <= it.model.gate(1)) == heard
    assert np.array_equal(state.covariance, before.covariance) != heard


def test_what_a_receiver_says_of_its_error_is_the_whole_of_it() -> None:
    stated = np.diag([4.0, 9.0, 1.0])
    white = position_fix(GNSS.positions, np.zeros(3), True, stated).covariance
    # 1.5 m of it changes slowly, of the height 1.5 times as much; a tenth is left at least
    np.testing.assert_allclose(np.diag(white), [4.0 - 2.25, 9.0 - 2.25, 0.1])
    flat = position_fix(GNSS.positions, np.zeros(3), True, np.diag([4.0, 9.0, 0.0])).covariance
    own = position_fix(GNSS.positions, np.zeros(3), True).covariance
    np.testing.assert_allclose(np.diag(flat), [4.0 - 2.25, 9.0 - 2.25, own[2, 2]])
    assert satellite_velocity(GNSS, np.full(3, np.nan), np.zeros(3)) is None
    known = satellite_velocity(GNSS, np.ones(3), np.zeros(3), np.diag([0.04, 0.0, 0.0]))
    np.testing.assert_allclose(np.sqrt(np.diag(known.covariance)), [0.2, 0.03, 0.045])
    only = GroundVelocity(np.array([4.0, np.nan, np.nan]), np.eye(3), np.zeros(3))
    assert only.update(FLIGHT.start.copy(), open_model()).innovation.shape == (1,)


def test_a_course_of_a_slow_vehicle_says_nothing() -> None:
    model = fly(headings=HEADINGS).model
    state = FilterState.start(FLIGHT.start.estimate, model)
    state.velocity[:2] = 1.0, 2.0
    result = HeadingReading.of(HEADINGS[2], 0.0, 2025.0).update(state, model)
    assert not result.used
    assert "slower than 3 m/s" in result.reason
