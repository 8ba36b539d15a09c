"""The error of a map from tracks with known positions: the parameters that simulated errors were
drawn with are found."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.tracks import made_track
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.tracks.continued_map import rms_gradient
from isogal.tracks.map_error import reading_sigma, with_learnt_error

FIELD = field_map_of(wavy)


def reference_tracks(field_map, sigma_of, length, sensor, tracks=6, count=150):
    """Tracks at their true positions over a map whose error has the given 1-sigma and correlation
    length."""
    result = []
    for number in range(tracks):
        way = {"start": (-20e3 + 6e3 * number, -20e3), "step": (30.0, 260.0)}
        track, *at = made_track(field_map, count, sigma=sensor, seed=number, **way)
        sigma = sigma_of(*at)
        distance = np.hypot(
            *np.moveaxis(horizontal_difference(*(axis[:, None] for axis in at), *at), -1, 0)
        )
        covariance = np.exp(-distance / length) * np.outer(sigma, sigma)
        factor = np.linalg.cholesky(covariance + np.diag(1e-6 * sigma**2))
        error = factor @ np.random.default_rng(100 + number).standard_normal(count)
        result.append(replace(track, value=track.value + error))
    return result


def test_size_and_length_of_an_error_that_the_map_says_in_proportion():
    side = np.linspace(1e-5, 6e-5, FIELD.values.shape[0])[:, None] * np.ones(FIELD.values.shape)
    truth = replace(FIELD, sigma=side)
    said = replace(FIELD, sigma=0.5 * side)
    tracks = reference_tracks(truth, truth.sigma_at, 3000.0, 2e-5)
    learnt, sigma = with_learnt_error(tracks, said)
    assert learnt.correlation_length == pytest.approx(3000.0, rel=0.5)
    assert np.median(learnt.sigma / side) == pytest.approx(1.0, abs=0.25)
    assert np.corrcoef(np.ravel(learnt.sigma), np.ravel(side))[0, 1] > 0.8
    along = [truth.sigma_at(one.latitude, one.longitude) for one in tracks]
    assert sigma == pytest.approx(np.sqrt(np.mean(np.square(along))), rel=0.25)
    assert reading_sigma(tracks, said) == pytest.approx(2e-5, rel=0.25)


def test_an_error_in_proportion_to_the_gradient():
    rough = replace(FIELD, sigma=600.0 * rms_gradient(FIELD))
    tracks = reference_tracks(FIELD, rough.sigma_at, 2500.0, 2e-6)
    learnt, _ = with_learnt_error(tracks, FIELD)
    assert learnt.correlation_length == pytest.approx(2500.0, rel=0.5)
    at = tracks[0].latitude, tracks[0].longitude
    found, drawn = (one.sigma_at(*at) for one in (learnt, rough))
    np.testing.assert_allclose(np.median(found / drawn), 1.0, atol=0.25)
    assert np.corrcoef(found, drawn)[0, 1] > 0.9


def test_tracks_off_the_map_cannot_be_used():
    track, _, _ = made_track(FIELD)
    with pytest.raises(InputError, match="no reference track lies on the map"):
        with_learnt_error([replace(track, latitude=track.latitude + 0.2)], FIELD)
