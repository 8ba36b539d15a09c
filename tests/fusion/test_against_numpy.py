"""Compiled strapdown and filter against plain NumPy and filterpy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusion.numpy_strapdown import State, strapdown
from helpers.navigators import SIGMA, error_between, random_covariance
from isogal.fusion.model import FilterModel
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.strapdown import propagate as propagate_ins


def random_estimates(random: np.random.Generator, count: int) -> Estimate:
    position = random.uniform([-1.3, -3.0, -4e3], [1.3, 3.0, 9e3], (count, 3))
    velocity = random.uniform(-200.0, 200.0, (count, 3))
    return Estimate(position, velocity, Rotation.random(count, random).as_quat(scalar_first=True))


def matrices(nav: Estimate) -> np.ndarray:
    return Rotation.from_quat(nav.attitude, scalar_first=True).as_matrix()


@pytest.mark.parametrize("dt", [1.0, 0.01])
def test_strapdown_step_equals_reference(dt: float) -> None:
    random = np.random.default_rng(1)
    nav = random_estimates(random, 200)
    force, rate = random.normal(0.0, 10.0, (200, 1, 3)), random.normal(0.0, 0.2, (200, 1, 3))
    end, _ = propagate_ins(nav, force, rate, dt)
    start = State(nav.position, nav.velocity, matrices(nav))
    expected = strapdown(start, force[:, 0], rate[:, 0], dt)
    apart = (end.position - expected.position) * [6.4e6, 6.4e6, 1.0]
    np.testing.assert_allclose(apart, 0.0, atol=1e-8)
    np.testing.assert_allclose(end.velocity, expected.velocity, rtol=0, atol=1e-8)
    np.testing.assert_allclose(matrices(end), expected.attitude, rtol=0, atol=1e-14)


def filter_start(random: np.random.Generator, sigma: np.ndarray, seed: int) -> FilterState:
    """Return a state with a full, well-scaled random covariance."""
    nav = random_estimates(random, 1)
    return FilterState(
        np.array([*nav.position[0, :2], 100.0]),
        np.array([*nav.velocity[0, :2], 0.0]),
        nav.attitude[0],
        random.normal(0.0, 1e-5, 3),
        random.normal(0.0, 1e-8, 3),
        np.zeros(0),
        random_covariance(sigma, seed),
        np.zeros(2),
    )


@pytest.mark.parametrize(
    ("heading", "parameters"),
    [(1e-3, (1.0, 2.0, 0.0)), (1e-3, (0.5, 2.0, 1.0)), (0.4, (1.0, 2.0, 0.0))],
    ids=["default", "other weights", "unknown heading"],
)
def test_filter_equals_reference(heading: float, parameters: tuple[float, float, float]) -> None:
    """Also where the heading is unknown to 0.4 rad: points 1.5 rad apart."""
    random, steps, sigma = np.random.default_rng(2), 4, SIGMA.copy()
    sigma[8] = heading
    noise = (8e-5, 7e-5, 1e-2, 5e-9, 6e-9, 1.5e-7)
    model = FilterModel(noise, tuple(sigma), 1.0, 0.1, *parameters)
    for seed in range(5):
        start = filter_start(random, sigma, seed)
        force = random.normal(0.0, 10.0, (steps, 3))
        rate = random.normal(0.0, 0.02, (steps, 3))
        height = 100.0 + random.normal(0.0, 0.5, steps)
        if heading > 0.1:
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
