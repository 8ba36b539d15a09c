"""Compiled strapdown and filter against plain NumPy and filterpy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers.navigators import SIGMA, assert_close, random_covariance
from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE, radii
from isogal.earth.gravity import normal_gravity
from isogal.fusion.model import FilterModel
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.strapdown import propagate as propagate_ins


def _rates(latitude: Array, height: Array, velocity: Array) -> tuple[Array, Array]:
    """Earth rate and transport rate (P, 3), NED, rad/s (Groves 2013, eqs. 5.41, 5.44)."""
    meridian, normal = radii(latitude)
    earth = EARTH_RATE * np.stack([np.cos(latitude), 0 * latitude, -np.sin(latitude)], axis=-1)
    north, east = velocity[:, 0] / (meridian + height), velocity[:, 1] / (normal + height)
    return earth, np.stack([east, -north, -east * np.tan(latitude)], axis=-1)


def strapdown(state: Estimate, force: Array, rate: Array, dt: float) -> Estimate:
    """One interval for P points, whose attitudes are matrices body to NED (P, 3, 3), with mean
    specific force and angular rate (P, 3), body axes: written after the books, not after the
    compiled functions."""
    latitude, longitude, height = state.position.T
    u = np.einsum("pij,pj->pi", state.attitude, force) * dt
    a = np.einsum("pij,pj->pi", state.attitude, rate) * dt
    down = np.array([0.0, 0.0, 1.0])

    earth, transport = _rates(latitude, height, state.velocity)
    coriolis = np.cross(2 * earth + transport, state.velocity)
    middle = state.velocity + 0.5 * (
        u + dt * (normal_gravity(latitude, height)[:, None] * down - coriolis)
    )
    mean_velocity = 0.5 * (state.velocity + middle)
    half_way = latitude + 0.5 * dt * mean_velocity[:, 0] / (radii(latitude)[0] + height)
    height_half_way = height - 0.5 * dt * mean_velocity[:, 2]

    earth, transport = _rates(half_way, height_half_way, middle)
    z = (earth + transport) * dt
    au, zu = np.cross(a, u), np.cross(z, u)
    increment = u + 0.5 * (au - zu) + (np.cross(a, au) + np.cross(z, zu)) / 6 - np.cross(z, au) / 3
    gravity = normal_gravity(half_way, height_half_way)[:, None] * down
    velocity = (
        state.velocity + increment + dt * (gravity - np.cross(2 * earth + transport, middle))
    )

    moved = 0.5 * dt * (state.velocity + velocity)
    meridian, normal = radii(half_way)
    position = np.stack(
        [
            latitude + moved[:, 0] / (meridian + height_half_way),
            longitude + moved[:, 1] / ((normal + height_half_way) * np.cos(half_way)),
            height - moved[:, 2],
        ],
        axis=-1,
    )
    az = np.cross(a, z)
    attitude = (
        Rotation.from_rotvec(a - z + az / 2 - np.cross(a, az) / 6).as_matrix() @ state.attitude
    )
    return Estimate(position, velocity, attitude)


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
    start = Estimate(nav.position, nav.velocity, matrices(nav))
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
        assert_close(compiled, by_filterpy, 1e-8, 2e-8)
        np.testing.assert_array_equal(track[-1, :10], np.concatenate(compiled.estimate))
        np.testing.assert_allclose(track, theirs, rtol=1e-6, atol=1e-6)
