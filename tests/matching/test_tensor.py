"""Batches of the gravity gradient tensor whose map errors come from one potential."""

from dataclasses import replace

import numpy as np
import pytest
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.map_error import MapErrorEstimate
from isogal.matching.pmht.noise_model import NoiseModel

from helpers.batches import field_map_of, make_batch, wavy
from isogal.maps.gradients import tensor_maps
from isogal.maps.tensor_error import (
    displacements,
    tensor_covariance,
)
from isogal.matching.batching import BatchBuilder
from isogal.matching.channels import channel_batch, first_channel
from isogal.matching.expansion import expansion_of
from isogal.scenario import load_scenario

EOTVOS = 1e-9
COMPONENTS = ("nn", "nd", "ed", "dd")
DISTURBANCE = field_map_of(wavy, half=40e3)
MAPS = tensor_maps(DISTURBANCE, COMPONENTS, edge=15e3)
SCANS, C = 12, len(COMPONENTS)
NOISE = NoiseModel(4.0 * EOTVOS, 700.0, 2.0 * EOTVOS)


def batch_of(readings=None):
    scalar, _ = make_batch(DISTURBANCE, np.zeros(4), SCANS)
    if readings is None:
        readings = MAPS.value(scalar.latitude, scalar.longitude)
    batch = channel_batch(scalar, readings, EOTVOS**2 * np.eye(C))
    return replace(batch, of_one_potential=COMPONENTS)


def shape_of(batch, rows, length):
    apart = displacements(batch.latitude[rows], batch.longitude[rows])
    return tensor_covariance(COMPONENTS, batch.channel[rows], apart, length)


def test_the_likelihood_has_the_covariance_of_one_potential():
    readings = np.zeros((SCANS, C))
    readings[3, 2] = np.nan
    batch = batch_of(readings)
    rows = np.flatnonzero(np.isfinite(batch.reading))
    channel = batch.channel[rows]
    expected = (4.0 * EOTVOS) ** 2 * shape_of(batch, rows, 700.0) + EOTVOS**2 * np.eye(len(rows))
    expected += (2.0 * EOTVOS) ** 2 * (channel[:, None] == channel)
    found = BatchLikelihood.of(batch, MAPS, NOISE).covariance
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * EOTVOS**2)
    assert np.abs(found[0, 3]) > 5.0 * EOTVOS**2  # nn and dd at one place
    plain = BatchLikelihood.of(replace(batch, of_one_potential=None), MAPS, NOISE).covariance
    assert plain[0, 3] == 0.0


def test_what_the_maps_say_of_themselves_is_of_each_channel():
    sigma = EOTVOS * np.array([6.0, 7.0, 8.0, 10.0])
    told = [
        replace(one, sigma=float(own), correlation_length=length)
        for one, own, length in zip(
            MAPS.channels, sigma, (500.0, 600.0, 700.0, 600.0), strict=True
        )
    ]
    batch = batch_of()
    found = BatchLikelihood.of(batch, type(MAPS)(told), NoiseModel()).covariance
    shape = shape_of(batch, np.arange(len(batch)), 600.0)
    scale = np.tile(sigma, SCANS) / np.sqrt(np.diag(shape))
    apart = displacements(batch.latitude, batch.longitude)
    alone = np.exp(-np.hypot(apart[..., 0], apart[..., 1]) / 600.0) * np.diag(shape)
    # 15 % of the variance is each channel's own
    shape = 0.85 * shape + 0.15 * alone * (batch.channel[:, None] == batch.channel)
    expected = np.outer(scale, scale) * shape + EOTVOS**2 * np.eye(len(batch))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * EOTVOS**2)


def test_the_map_error_is_learnt_as_one_potential():
    """Of 12 x 4 readings: sigma of dd within a factor of two, and more likely than as errors of
    each channel by itself."""
    exact = batch_of()
    rows = np.arange(len(exact))
    root = np.linalg.cholesky(shape_of(exact, rows, 700.0) + 1e-9 * np.eye(len(rows)))
    random = np.random.default_rng(2)
    sigma, gain = [], []
    for _ in range(6):
        wrong = 10.0 * EOTVOS * root @ random.standard_normal(len(rows))
        noise = EOTVOS * random.standard_normal(len(rows))
        batch = replace(exact, reading=exact.reading + wrong + noise)
        each = {}
        for tensor in (COMPONENTS, None):
            one = replace(batch, of_one_potential=tensor)
            start = MapErrorEstimate.told(NoiseModel(6.0 * EOTVOS, 700.0), 2.0)
            likelihood = BatchLikelihood.of(one, MAPS, NOISE)
            each[tensor] = start.update(one, likelihood, MAPS, np.zeros(4))
        sigma.append(each[COMPONENTS].model(NOISE).map_sigma / EOTVOS)
        gain.append(each[COMPONENTS].log_weight.max() - each[None].log_weight.max())
    assert 7.0 < np.median(sigma) < 14.0
    assert np.mean(gain) > 5.0


def test_a_scenario_says_it():
    level = "gradiometer.allowed_tilt=0"
    assert expansion_of(load_scenario(None, ["field=gradient", level])) is None
    settings = load_scenario(
        None,
        [
            "field=gradient",
            "gradiometer.map_errors=one_potential",
            "gradiometer.components=[nd, ed]",
            "matcher.batch_length=3",
        ],
    )
    builder = BatchBuilder.of(settings)
    for k in range(3):
        builder.add_scan(10.0 * k, -0.6, 2.5 + 1e-5 * k, np.array([0.0, 20.0]), np.ones(2), 1.0)
    batch = builder.build(np.diag([1e4, 1e4, 1.0, 1.0, 1e-8, 1e-8, 1e-8]))
    assert batch.of_one_potential == ("nd", "ed")
    assert len(batch) == 6
    first, _ = first_channel(batch_of(), MAPS)
    assert first.of_one_potential is None and len(first) == SCANS


def test_truth_can_differ():
    settings = load_scenario(
        None, ["field=gradient", "truth.gradiometer.map_errors=one_potential"]
    )
    assert settings.gradiometer.of_one_potential is None
    assert settings.world.gradiometer.of_one_potential == ("nn", "ne", "nd", "ee", "ed")
    with pytest.raises(Exception, match=r"map_errors.*one_potential"):
        load_scenario(None, ["field=gradient", "gradiometer.map_errors=often"])
