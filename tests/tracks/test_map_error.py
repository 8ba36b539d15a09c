"""The error of a map from tracks with known positions: the parameters that simulated errors were
drawn with are found."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.tracks import made_track
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.tracks.map_error import fit_map_error, rms_gradient

FIELD = field_map_of(wavy)


def reference_tracks(field_map, sigma_of, length, sensor, tracks=6, count=150):
    """Tracks at their true positions over a map whose error has the given 1-sigma and correlation
    length."""
    result = []
    for number in range(tracks):
        track, _, _ = made_track(
            field_map,
            count=count,
            sigma=sensor,
            seed=number,
            start=(-20e3 + 6e3 * number, -20e3),
            step=(30.0, 260.0),
        )
        sigma = sigma_of(track.latitude, track.longitude)
        at = track.latitude, track.longitude
        apart = horizontal_difference(*(axis[:, None] for axis in at), *at)
        covariance = (
            np.exp(-np.hypot(apart[..., 0], apart[..., 1]) / length) * sigma[:, None] * sigma
        )
        covariance += np.diag(1e-6 * sigma**2)
        error = np.linalg.cholesky(covariance) @ np.random.default_rng(
            100 + number
        ).standard_normal(count)
        result.append(replace(track, value=track.value + error))
    return result


def test_length_and_sensor_noise_on_a_map_with_its_own_sigma():
    side = np.linspace(1e-5, 6e-5, FIELD.values.shape[0])[:, None] * np.ones(FIELD.values.shape[1])
    field_map = replace(FIELD, sigma=side)
    fit = fit_map_error(reference_tracks(field_map, field_map.sigma_at, 3000.0, 2e-5), field_map)
    assert fit.correlation_length == pytest.approx(3000.0, rel=0.25)
    assert fit.sensor_sigma == pytest.approx(2e-5, rel=0.2)
    applied = fit.apply(field_map)
    assert applied.correlation_length == fit.correlation_length
    np.testing.assert_array_equal(applied.sigma, field_map.sigma)


def test_an_error_in_proportion_to_the_gradient():
    rough = replace(FIELD, sigma=rms_gradient(FIELD))

    def sigma_of(latitude, longitude):
        return np.hypot(5e-6, 600.0 * rough.sigma_at(latitude, longitude))

    fit = fit_map_error(reference_tracks(FIELD, sigma_of, 2500.0, 2e-6), FIELD)
    assert fit.reach == pytest.approx(600.0, rel=0.25)
    assert fit.correlation_length == pytest.approx(2500.0, rel=0.3)
    track = reference_tracks(FIELD, sigma_of, 2500.0, 2e-6, tracks=1)[0]
    found = fit.apply(FIELD).sigma_at(track.latitude, track.longitude)
    assert np.median(found / sigma_of(track.latitude, track.longitude)) == pytest.approx(
        1.0, abs=0.2
    )


def test_gradient_of_a_plane_also_at_edges_and_round_holes():
    plane = field_map_of(lambda north, east: 3e-8 * north + 4e-8 * east)
    np.testing.assert_allclose(rms_gradient(plane), 5e-8, rtol=0.01)
    values = plane.values.copy()
    values[80:160, 80:160] = np.nan
    holed = rms_gradient(replace(plane, values=values))
    assert np.isnan(holed[120, 120])
    np.testing.assert_allclose(holed[np.isfinite(holed)], 5e-8, rtol=0.01)


def test_tracks_off_the_map_cannot_be_used():
    track, _, _ = made_track(FIELD)
    with pytest.raises(InputError, match="no reference track lies on the map"):
        fit_map_error([replace(track, latitude=track.latitude + 0.2)], FIELD)
