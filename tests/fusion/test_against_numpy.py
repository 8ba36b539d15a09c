"""Compiled strapdown, filter and rotations against plain NumPy, filterpy and scipy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fusion.numpy_strapdown import State, strapdown
from helpers.navigators import error_between
from isogal.fusion.model import FilterModel
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.inertial import rotations
from isogal.inertial.error_state import Estimate
from isogal.inertial.strapdown import propagate as propagate_ins

R_E = 6.4e6


def random_quaternions(random: np.random.Generator, count: int) -> np.ndarray:
    return Rotation.random(count, random).as_quat(scalar_first=True)


def random_nav(random: np.random.Generator, count: int) -> Estimate:
    position = np.stack(
        [
            random.uniform(-1.3, 1.3, count),
            random.uniform(-3.0, 3.0, count),
            random.uniform(-4e3, 9e3, count),
        ],
        axis=-1,
    )
    return Estimate(
        position, random.uniform(-200.0, 200.0, (count, 3)), random_quaternions(random, count)
    )


def as_reference(nav: Estimate) -> State:
    matrices = Rotation.from_quat(nav.attitude, scalar_first=True).as_matrix()
    return State(nav.position, nav.velocity, matrices)


def agree(state: State, nav: Estimate, metres: float, radians: float) -> None:
    """Positions to so many metres, velocities to that per second, attitudes to so many radians."""
    np.testing.assert_allclose(
        nav.position[:, :2], state.position[:, :2], rtol=0, atol=metres / R_E
    )
    np.testing.assert_allclose(
        nav.position[:, 2], state.position[:, 2], rtol=0, atol=max(metres, 1e-8)
    )
    np.testing.assert_allclose(nav.velocity, state.velocity, rtol=0, atol=metres)
    matrices = Rotation.from_quat(nav.attitude, scalar_first=True).as_matrix()
    np.testing.assert_allclose(matrices, state.attitude, rtol=0, atol=radians)


@pytest.mark.parametrize("dt", [1.0, 0.01])
def test_strapdown_step_equals_reference(dt: float) -> None:
    random = np.random.default_rng(1)
    nav = random_nav(random, 200)
    force, rate = random.normal(0.0, 10.0, (200, 1, 3)), random.normal(0.0, 0.2, (200, 1, 3))
    end, _ = propagate_ins(nav, force, rate, dt)
    agree(strapdown(as_reference(nav), force[:, 0], rate[:, 0], dt), end, 1e-8, 1e-14)


def filter_start(random: np.random.Generator, sigma: np.ndarray) -> FilterState:
    """Return a state with a full, well-scaled random covariance."""
    nav = random_nav(random, 1)
    root = np.eye(15) + 0.2 * random.standard_normal((15, 15))
    return FilterState(
        np.array([*nav.position[0, :2], 100.0]),
        np.array([*nav.velocity[0, :2], 0.0]),
        nav.attitude[0],
        random.normal(0.0, 1e-5, 3),
        random.normal(0.0, 1e-8, 3),
        np.zeros(0),
        root @ root.T * sigma * sigma[:, None],
        np.zeros(2),
    )


SIGMA = np.array(
    [300.0, 300.0, 3.0, 0.3, 0.3, 0.05, 1e-4, 1e-4, 1e-3, 1e-5, 1e-5, 1e-6, 1e-9, 1e-9, 1e-8]
)


@pytest.mark.parametrize(
    ("sigma", "parameters"),
    [
        (SIGMA, (1.0, 2.0, 0.0)),
        (SIGMA, (0.5, 2.0, 1.0)),
        # heading unknown to 0.4 rad: points 1.5 rad apart
        (SIGMA * ([1.0] * 8 + [400.0] + [1.0] * 6), (1.0, 2.0, 0.0)),
    ],
    ids=["default", "other weights", "unknown heading"],
)
def test_filter_equals_reference(
    sigma: np.ndarray, parameters: tuple[float, float, float]
) -> None:
    random, steps = np.random.default_rng(2), 4
    noise = (8e-5, 7e-5, 1e-2, 5e-9, 6e-9, 1.5e-7)
    model = FilterModel(noise, tuple(sigma), 1.0, 0.1, *parameters)
    for _ in range(5):
        start = filter_start(random, sigma)
        force = random.normal(0.0, 10.0, (steps, 3))
        rate = random.normal(0.0, 0.02, (steps, 3))
        height = 100.0 + random.normal(0.0, 0.5, steps)
        if sigma is not SIGMA:
            # the reference adds the prediction's mean and the height's correction at once, which
            # is not the same for a large turn
            height[:] = np.nan
        compiled, by_filterpy = start.copy(), start.copy()
        track = propagate(compiled, model, force, rate, height)
        theirs = propagate(by_filterpy, replace(model, filter="reference"), force, rate, height)
        deviation = np.sqrt(np.diag(by_filterpy.covariance))
        apart = error_between(compiled, by_filterpy) / deviation
        np.testing.assert_allclose(apart, 0.0, atol=1e-8)
        unlike = (compiled.covariance - by_filterpy.covariance) / deviation / deviation[:, None]
        np.testing.assert_allclose(unlike, 0.0, atol=2e-8)
        np.testing.assert_array_equal(track[-1, :10], np.concatenate(compiled.estimate))
        np.testing.assert_allclose(track, theirs, rtol=1e-6, atol=1e-6)


axes = st.floats(-1.0, 1.0)


@settings(max_examples=200, deadline=None)
@given(axes, axes, axes, st.floats(0.0, 7.0))
def test_rotation_vectors_equal_scipy_and_invert(
    x: float, y: float, z: float, angle: float
) -> None:
    length = math.sqrt(x * x + y * y + z * z)
    vector = np.array([x, y, z]) / length * angle if length > 1e-3 else np.zeros(3)
    quaternion = np.array(rotations.from_rotation_vector(*vector))
    expected = Rotation.from_rotvec(vector).as_quat(scalar_first=True)
    np.testing.assert_allclose(
        quaternion, expected if expected @ quaternion > 0 else -expected, atol=4e-16
    )
    back = np.array(rotations.to_rotation_vector(*quaternion))
    if angle < 3.14:  # beyond half a turn it comes back the short way
        np.testing.assert_allclose(back, vector, atol=4e-15)
