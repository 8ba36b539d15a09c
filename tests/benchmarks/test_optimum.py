"""The reference that fixes are compared with, where the right answer is known."""

from types import SimpleNamespace

import numpy as np
import optimum
from optimum import Data, Model, posterior

from helpers.route_maps import field, waves
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.consistency import nees_per_axis
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory

SCANS, SIZE, LATITUDE = 60, 5, -0.6
NORTH, EAST = metres_per_radian(LATITUDE)
SPEED = 200.0
"""m from scan to scan."""


def model_of(bend):
    """A vehicle with random accelerations that goes east, and a map error that is a Gauss-Markov
    process. The map is a plane, with waves on it where `bend` is not zero."""
    transition = np.eye(SIZE)
    transition[[0, 1], [2, 3]] = 10.0
    transition[4, 4] = 0.9
    noise = np.diag([1.0, 1.0, 1e-4, 1e-4, 1.0 - 0.9**2])

    def value_and_gradient(latitude, longitude):
        x, y = latitude * NORTH, longitude * EAST
        k, height = 1.0 / 200.0, 5.0 * bend
        value = 0.01 * x + 0.004 * y + height * np.sin(k * (x + 0.7 * y)) * np.cos(k * y)
        slope = height * k * np.cos(k * (x + 0.7 * y)) * np.cos(k * y)
        other = -height * k * np.sin(k * (x + 0.7 * y)) * np.sin(k * y)
        return value, 0.01 + slope, 0.004 + 0.7 * slope + other

    return Model(
        start=np.diag([300.0**2, 300.0**2, 0.5**2, 0.5**2, 1.0]),
        transition=np.tile(transition, (SCANS, 1, 1)),
        noise=np.tile(noise, (SCANS, 1, 1)),
        by_state=np.tile([0.0, 0.0, 0.3, 0.2, 1.0], (SCANS, 1)),
        variance=0.5**2,
        field_map=SimpleNamespace(value_and_gradient=value_and_gradient),
        latitude=np.full(SCANS, LATITUDE),
        longitude=SPEED * np.arange(SCANS) / EAST,
    )


def drawn(model, random):
    """What is seen of a run of the model."""
    state = np.linalg.cholesky(model.start) @ random.standard_normal(SIZE)
    states = []
    for transition, noise in zip(model.transition, model.noise, strict=True):
        state = transition @ state + np.sqrt(np.diag(noise)) * random.standard_normal(SIZE)
        states.append(state)
    states = np.array(states)
    white = np.sqrt(model.variance) * random.standard_normal(SCANS)
    return Data(states[:, :4], states[:, 4] + white)


def test_over_a_plane_it_is_the_kalman_filter():
    model, random = model_of(0.0), np.random.default_rng(1)
    data = drawn(model, random)
    exact = posterior(model, data, 1, 100.0, random)
    one, two = (posterior(model, data, 3000, width, random) for width in (0.7, 0.5))
    for found in (one, two):
        scale = np.sqrt(np.einsum("kii->ki", exact.covariance))
        assert np.abs((found.error - exact.error) / scale).max() < 0.3
        ratio = np.einsum("kii->ki", found.covariance) / scale**2
        assert ratio.min() > 0.8 and ratio.max() < 1.25


def test_over_hills_it_is_consistent_where_one_gaussian_is_not():
    """Of 30 runs, 3 sigma of the mean NEES per axis is 0.55."""
    model, random = model_of(1.0), np.random.default_rng(2)
    data = [drawn(model, random) for _ in range(30)]

    def nees(particles, width):
        found = [posterior(model, one, particles, width, random) for one in data]
        return np.mean([nees_per_axis(one.error[-1], one.covariance[-1]) for one in found])

    assert 0.45 < nees(400, 0.5) < 1.55
    assert nees(1, 100.0) > 2.0


def test_its_model_is_that_of_the_bound():
    """A Kalman filter of it, over the true track, has the bound's covariance."""
    settings = ["route.duration=600", "gravity.field=normal", "map_error.sigma=3e-5"]
    scenario = load_scenario(None, settings)
    trajectory, field_map = build_trajectory(scenario), field(waves)
    model = optimum.model_of(scenario, trajectory, field_map)
    P, found = model.start, []
    for scan, (transition, noise) in enumerate(zip(model.transition, model.noise, strict=True)):
        P = transition @ P @ transition.T + noise
        row = model.by_state[scan].copy()
        row[:2] -= model.map_at(scan, np.zeros((1, 2)))[1][0]
        P = P - np.outer(P @ row, row @ P) / (row @ P @ row + model.variance)
        found.append(P[:2, :2])
    expected = posterior_cramer_rao(scenario.true, trajectory, field_map).covariance[1:]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
