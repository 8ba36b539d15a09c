"""Constants that are estimated along: what conditioning on all readings says of them, and places
that they move."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.matching.parameters import Parameters
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.noise_model import NoiseModel
from isogal.matching.pmht.sensor_bias import BiasEstimate
from isogal.matching.registry import require
from isogal.scenario import Matcher

SIGMA, SCANS = 1e-5, 20
SLOPE = np.array([4e-8, -3e-8])
PLANE = field_map_of(
    lambda north, east: SLOPE[0] * north + SLOPE[1] * east, half=60e3, step=2000.0
)


def batch_with(theta, parameters, seed=3):
    """A batch of a navigator without error whose readings contain parameters."""
    batch, _ = make_batch(PLANE, np.zeros(4), SCANS, sigma=SIGMA, seed=seed)
    return replace(
        batch,
        prior=np.diag(np.square([1e-3, 1e-3, 1e-6, 1e-6])),
        reading=batch.reading + parameters.reading @ theta,
        parameters=parameters,
    )


def learnt(batch):
    """What the matcher believes after the batch of bias, drift and parameters."""
    start = BiasEstimate.unknown(float(batch.time[0]), 0.0, 0.0, 0.0, batch.parameters)
    bias = start.at_end(batch)
    whole = bias.added_to(batch)
    likelihood = BatchLikelihood.of(whole, PLANE, NoiseModel())
    return bias.measured(whole, likelihood, np.zeros(4), batch.prior)


def test_parameters_are_a_regression_where_the_place_is_known():
    random = np.random.default_rng(1)
    columns, sigma = random.standard_normal((SCANS, 3)), np.array([1e-4, 2e-4, 5e-5])
    theta = sigma * random.standard_normal(3)
    batch = batch_with(theta, Parameters(("first",), sigma, columns))
    residual, _ = BatchLikelihood.of(batch, PLANE, NoiseModel()).linearise(np.zeros(4))
    inverse = columns.T @ columns / SIGMA**2 + np.diag(sigma**-2.0)
    expected = np.linalg.solve(inverse, columns.T @ residual / SIGMA**2)
    found = learnt(batch)
    np.testing.assert_allclose(found.mean[2:], expected, atol=1e-3 * SIGMA)
    np.testing.assert_allclose(found.covariance[2:, 2:], np.linalg.inv(inverse), rtol=1e-3)
    assert set(found.figures()) >= {"first", "first_sigma"}


def test_a_parameter_that_moves_places_counts_by_the_maps_slope():
    off = np.zeros((SCANS, 2, 1))
    off[:, 0, 0] = np.linspace(-500.0, 500.0, SCANS)  # m north per unit
    still = Parameters((), np.array([2.0]), np.zeros((SCANS, 1)), off)
    # the reading is of the true place, which lies off to the south of where it is believed
    batch = replace(
        batch_with(np.zeros(1), still),
        reading=batch_with(np.zeros(1), still).reading - SLOPE[0] * off[:, 0, 0] * 1.5,
    )
    found = learnt(batch)
    assert found.mean[2] == pytest.approx(1.5, abs=4.0 * np.sqrt(found.covariance[2, 2]))
    assert np.sqrt(found.covariance[2, 2]) < 0.4


def test_a_matcher_with_parameters_finds_its_place():
    columns = np.sin(np.arange(SCANS))[:, None]
    theta, sigma = np.array([30.0 * SIGMA]), np.array([100.0 * SIGMA])
    error = np.array([150.0, -100.0, 0.0, 0.0])
    wavy = field_map_of(
        lambda north, east: 1e-4 * np.sin(north / 900.0) * np.cos(east / 1100.0), half=20e3
    )
    batch, _ = make_batch(wavy, error, SCANS, sigma=SIGMA, seed=5)
    batch = replace(batch, reading=batch.reading + columns @ theta)
    told = replace(batch, parameters=Parameters((), sigma, columns))
    matcher = Pmht.from_settings(Matcher(name="pmht", map_sigma=0.0))
    fix, memory = matcher.match(told, wavy, None)
    assert fix.published
    assert memory.bias.mean[2] == pytest.approx(theta[0], rel=0.2)
    at = np.array([fix.latitude - batch.latitude[-1], fix.longitude - batch.longitude[-1]])
    off = at * metres_per_radian(batch.latitude[-1]) + error[:2]
    assert off @ np.linalg.solve(fix.covariance, off) < 18.4  # once in 10,000


def test_a_matcher_without_them_is_refused():
    require("pmht", "takes_parameters", "magnetometer.online")
    with pytest.raises(InputError, match=r"magnetometer.online: matcher tercom .* give pmht"):
        require("tercom", "takes_parameters", "magnetometer.online")
