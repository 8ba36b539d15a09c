"""Vector readings: the gradient tensor of a rough field, five components with correlated noise."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch, wavy
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.evaluation.consistency import chi_square_interval, nees_per_axis
from isogal.maps.channels import ChannelMap
from isogal.maps.potential import derivatives
from isogal.matching.expansion import channel_batch, first_channel
from isogal.matching.pmht.matcher import Pmht
from isogal.scenario import Matcher

EOTVOS = 1e-9
DISTURBANCE = field_map_of(wavy, half=50e3)
TENSOR = derivatives(DISTURBANCE, edge=15e3)
C = len(TENSOR)
COVARIANCE = EOTVOS**2 * (9.0 * np.eye(C) + 4.0 * np.ones((C, C)))
"""3 E on each channel and 2 E that all have together."""


def values_at(field_map, latitude, longitude):
    return np.stack([one.value(latitude, longitude) for one in field_map.channels], axis=-1)


def tensor_batch(
    error=(0.0, 0.0, 0.0, 0.0), seed=0, covariance=COVARIANCE, field_map=TENSOR, **keys
):
    """A batch of tensors along the track of `make_batch`; also the truth at its end."""
    scalar, truth = make_batch(DISTURBANCE, error, **keys)
    moved = scalar.transition @ np.array(error)
    north, east = metres_per_radian(scalar.latitude)
    tensors = values_at(
        field_map, scalar.latitude - moved[:, 0] / north, scalar.longitude - moved[:, 1] / east
    )
    noise = np.random.default_rng(seed).multivariate_normal(
        np.zeros(tensors.shape[1]), covariance, len(scalar), method="cholesky"
    )
    return channel_batch(scalar, tensors + noise, covariance), scalar, truth


def test_a_channel_without_a_reading_is_left_out():
    """A channel that reads nothing tells what is told without it."""
    batch, scalar, _ = tensor_batch()
    reading = batch.reading.reshape(-1, C).copy()
    reading[:, 4] = np.nan
    alone = 9.0 * EOTVOS**2 * np.eye(C)
    four = ChannelMap(TENSOR.channels[:4])
    matcher = Pmht.from_settings(Matcher(map_sigma=0.0))
    holed, _ = matcher.match(channel_batch(scalar, reading, alone), TENSOR, None)
    kept = channel_batch(scalar, reading[:, :4], alone[:4, :4])
    expected, _ = matcher.match(kept, four, None)
    np.testing.assert_allclose(holed.covariance, expected.covariance, rtol=1e-6)
    reading[3, 2] = np.nan
    fix, _ = matcher.match(channel_batch(scalar, reading, alone), TENSOR, None)
    assert np.trace(fix.covariance) > np.trace(holed.covariance)


def test_pmht_knows_how_well_five_components_tell_the_place():
    """Navigators off by draws of their prior: mean NEES in its 99.9 % interval, errors far below
    the prior."""
    matcher = Pmht.from_settings(Matcher(map_sigma=0.0))
    nees, errors = [], []
    for run in range(30):
        random = np.random.default_rng(1000 + run)
        error = np.concatenate([random.normal(0.0, 300.0, 2), random.normal(0.0, 0.02, 2)])
        batch, _, truth = tensor_batch(
            error,
            seed=run,
            prior_sigma=(300.0, 0.02),
            start=tuple(random.uniform(-12e3, 2e3, 2)),
            scans=20,
        )
        fix, _ = matcher.match(batch, TENSOR, None)
        assert fix.published, fix.reason
        errors.append(truth.error_of(fix))
        nees.append(float(nees_per_axis(errors[-1], fix.covariance)))
    low, high = chi_square_interval(len(nees), confidence=0.999)
    assert low < np.mean(nees) < high
    assert np.sqrt(np.mean(np.square(errors))) < 60.0


def test_what_is_shown_of_a_batch_is_its_first_channel():
    batch, scalar, _ = tensor_batch()
    shown, field_map = first_channel(replace(batch, new=10 * C), TENSOR)
    assert field_map is TENSOR.channels[0]
    assert shown.new == 10
    np.testing.assert_array_equal(shown.time, scalar.time)
    np.testing.assert_array_equal(shown.reading, batch.reading[::C])
    assert first_channel(scalar, DISTURBANCE) == (scalar, DISTURBANCE)
    fix, _ = Pmht.from_settings(Matcher(map_sigma=0.0)).match(batch, TENSOR, None)
    assert set(fix.candidates.scan) <= set(range(30))


def test_what_does_not_fit_is_refused_or_declined():
    scalar, _ = make_batch(DISTURBANCE)
    readings = np.zeros((30, 2))
    for bad, covariance, message in (
        (np.zeros((29, 2)), np.eye(2), r"must have shape \(30, channels\), have \(29, 2\)"),
        (np.zeros(30), np.eye(1), r"must have shape \(30, channels\), have \(30,\)"),
        (
            readings,
            np.eye(3),
            r"covariance of readings of several channels must have shape \(2, 2\)",
        ),
        (readings, -np.eye(2), "must be positive definite"),
        (readings, np.full((2, 2), np.nan), "must be positive definite"),
    ):
        with pytest.raises(InputError, match=message):
            channel_batch(scalar, bad, covariance)
    batch = channel_batch(scalar, readings, EOTVOS**2 * np.eye(2))
    fix, _ = Pmht.from_settings(Matcher()).match(batch, ChannelMap(TENSOR.channels[:1]), None)
    assert fix.reason == "the readings have 2 channels, the map 1"


def test_channels_must_lie_on_one_grid():
    coarse = field_map_of(wavy, step=1000.0)
    with pytest.raises(InputError, match="channel 1 of a vector map is on another grid"):
        ChannelMap([DISTURBANCE, coarse])
    with pytest.raises(InputError, match="channel 1 of a vector map is in nT, channel 0 in m/s²"):
        ChannelMap([DISTURBANCE, replace(DISTURBANCE, unit="nT")])
    with pytest.raises(InputError, match="at least one channel"):
        ChannelMap([])


def test_noise_worse_than_told_does_not_send_the_navigator_away():
    """Many noisy readings fit somewhere else by chance: five times the noise told, which is half
    of what the map changes."""
    matcher = Pmht.from_settings(Matcher())
    told = (35.0 * EOTVOS) ** 2 * np.eye(C)
    for seed in range(2):
        good, noisy = (
            tensor_batch(seed=seed, covariance=factor * told, prior_sigma=(50.0, 0.02))[0]
            for factor in (1.0, 25.0)
        )
        fix, _ = matcher.match(replace(good, reading=noisy.reading), TENSOR, None)
        assert not fix.reset, fix.reason
