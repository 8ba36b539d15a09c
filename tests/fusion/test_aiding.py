"""Height and velocity sensors in the filter."""

import numpy as np
import pytest

from helpers.navigators import error_between, fly
from isogal.fusion.aiding import update_height, update_velocity, velocity_reading
from isogal.fusion.navigator import propagate, widen
from isogal.fusion.nominal import move
from isogal.inertial.rotations import matrix
from isogal.scenario import Fusion, Height, Velocity
from isogal.sensors.barometer import simulate_heights

BAROMETER = Height(source="barometer", bias=6.0, scale=0.02, weather_sigma=4.0)
LOG = Velocity(kind="dvl", current_sigma=0.3)


def test_one_reading_tells_the_height_to_the_size_of_its_errors():
    """Before it nothing is known: the height follows the reading, its errors are as told, and
    height and errors go together."""
    it = fly(height=BAROMETER)
    state, model = it.start.copy(), it.model
    assert state.covariance[0, 2, 2] == 1000.0**2
    seen = update_height(state, model, 0, 112.0)
    assert seen.accepted
    assert state.position[0, 2] == pytest.approx(112.0, abs=0.01)
    size = np.sqrt(6.0**2 + 2.0**2 + 4.0**2 + 0.5**2)
    assert np.sqrt(state.covariance[0, 2, 2]) == pytest.approx(size, rel=1e-3)
    # the next reading is expected where the first one was
    again = update_height(state, model, 0, 112.0)
    assert again.nis < 0.1


@pytest.mark.parametrize("filter_", ["compiled", "reference"])
def test_heights_in_the_compiled_filter_are_those_of_the_linear_update(filter_):
    """Propagation with a reading at its end against propagation without, then the reading."""
    it = fly(height=BAROMETER, velocity=LOG, fusion=Fusion(filter=filter_))
    force, rate = it.imu.specific_force[:, :3], it.imu.angular_rate[:, :3]
    inside, after = it.start.copy(), it.start.copy()
    propagate(inside, it.model, force, rate, np.array([[np.nan, np.nan, 107.0]]))
    propagate(after, it.model, force, rate, np.full(3, np.nan))
    update_height(after, it.model, 0, 107.0)
    sigma = np.sqrt(np.diag(after.covariance[0]))
    np.testing.assert_allclose(error_between(inside, after) / sigma, 0.0, atol=1e-6)
    np.testing.assert_allclose(
        inside.covariance[0] / sigma / sigma[:, None],
        after.covariance[0] / sigma / sigma[:, None],
        atol=1e-7,
    )


def test_each_run_has_its_own_heights():
    it = fly(runs=(0, 1), height=BAROMETER, velocity=LOG)
    both, alone = it.start.copy(), fly(runs=(1,), height=BAROMETER, velocity=LOG).start
    height = simulate_heights(_scenario(), it.trajectory, [0, 1])[:, :50]
    force, rate = it.imu.specific_force[:, :50], it.imu.angular_rate[:, :50]
    propagate(both, it.model, force, rate, height)
    propagate(alone, it.model, force[1:], rate[1:], height[1:])
    np.testing.assert_array_equal(both.position[1], alone.position[0])
    assert abs(both.position[0, 2] - both.position[1, 2]) > 0.1


def _scenario():
    from helpers.navigators import ROUTE
    from isogal.scenario import Scenario

    return Scenario(route=ROUTE, height=BAROMETER)


def test_the_derivative_of_a_velocity_reading():
    """Against differences, in every state that it depends on."""
    it = fly(velocity=LOG)
    state, model = it.start, it.model
    state.auxiliary[0] = [0.01, 0.003, -0.004, 0.5, -0.2]
    names = [one.name for one in model.auxiliary]

    def read(nominal):
        values = dict(zip(names, nominal.auxiliary.tolist(), strict=True))
        past = nominal.velocity - [values["current_north"], values["current_east"], 0.0]
        return velocity_reading(model, matrix(nominal.attitude), past, values)

    H, _ = read(state.nominal_of(0))
    for column in (3, 4, 5, 6, 7, 8, *range(15, 20)):
        step, ends = np.zeros(model.states), []
        for sign in (1.0, -1.0):
            moved = state.copy()
            step[column] = sign * 1e-5
            move(moved.nominal_of(0), step)
            ends.append(read(moved.nominal_of(0))[1])
        np.testing.assert_allclose(H[:, column], (ends[0] - ends[1]) / 2e-5, atol=1e-5)
    assert not H[:, [0, 1, 2, 9, 10, 11, 12, 13, 14]].any()


def test_a_dvl_tells_the_velocity_and_knots_are_refused():
    it = fly(velocity=Velocity(kind="dvl"))
    state, model, settings = it.start, it.model, Velocity(kind="dvl")
    body = matrix(state.attitude[0]).T @ it.trajectory.velocity[0]
    before = state.copy()
    knots = update_velocity(state, model, 0, settings, body * 1.94384)
    assert not knots.accepted
    np.testing.assert_array_equal(state.covariance, before.covariance)
    assert np.linalg.norm(knots.measured) / np.linalg.norm(knots.expected) == pytest.approx(
        1.944, abs=0.01
    )
    assert update_velocity(state, model, 0, settings, body).accepted
    sigma = np.sqrt(np.diag(state.covariance[0]))
    assert sigma[4] < 0.8 * np.sqrt(before.covariance[0, 4, 4])
    assert update_velocity(state, model, 0, settings, np.full(3, np.nan)) is None


def test_zero_variance_means_that_the_setting_counts():
    settings = Velocity(kind="dvl")

    def sigma_after(covariance):
        state = fly(velocity=settings).start
        body = matrix(state.attitude[0]).T @ state.velocity[0]
        update_velocity(state, fly(velocity=settings).model, 0, settings, body, covariance)
        return np.sqrt(state.covariance[0, 3, 3])

    default = sigma_after(None)
    assert sigma_after(np.zeros((3, 3))) == default
    assert sigma_after(np.eye(3) * settings.number("sigma") ** 2) == pytest.approx(default)
    assert sigma_after(np.eye(3) * 4.0) > 1.2 * default
    state = fly(height=BAROMETER).start
    update_height(state, fly(height=BAROMETER).model, 0, 100.0, 0.0)
    assert np.isfinite(state.covariance).all()


def test_who_stands_still_has_no_velocity():
    settings = Velocity(kind="odometer", standstill_speed=0.1)
    it = fly(velocity=settings)
    state = it.start
    state.velocity[0] = [0.03, -0.02, 0.0]
    update_velocity(state, it.model, 0, settings, np.array([0.02, 0.0, 0.0]))
    assert np.linalg.norm(state.velocity[0]) < 0.01
    assert np.sqrt(state.covariance[0, 3, 3]) < 0.011


def test_a_contradicted_aid_is_not_used_any_more_but_a_standstill_is():
    it = fly(velocity=Velocity(kind="dvl", standstill_speed=0.1))
    state, settings = it.start.copy(), Velocity(kind="dvl", standstill_speed=0.1)
    widen(state, 0, np.diag([1e4, 1e4, 1.0, 1.0, 0.0, 0.0, 0.0]))
    before = state.copy()
    seen = update_velocity(state, it.model, 0, settings, np.array([22.0, 0.0, 0.0]))
    assert not seen.accepted
    assert seen.contradicted
    for array, old in zip(state.arrays(), before.arrays(), strict=True):
        np.testing.assert_array_equal(array, old)
    state.velocity[0] = 0.0
    assert update_velocity(state, it.model, 0, settings, np.zeros(3)).accepted
    # only the run that was contradicted
    both = fly(runs=(0, 1), velocity=Velocity(kind="dvl"))
    widen(both.start, 0, np.eye(7))
    reading = np.array([22.0, 0.0, 0.0])
    used = [update_velocity(both.start, both.model, run, settings, reading) for run in (0, 1)]
    assert [one.contradicted for one in used] == [True, False]
