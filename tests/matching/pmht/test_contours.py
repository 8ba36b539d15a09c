"""Candidates lie on the contours of the readings, near the posterior, weighted by it."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.matching.pmht.contours import contour_candidates

COVARIANCE = np.diag([150.0**2, 80.0**2, 0.05**2, 0.05**2])
ERROR = np.array([120.0, -60.0, 0.02, 0.01])


def errors_of(batch, candidates):
    """Navigator's error (m) that each candidate stands for."""
    t = candidates.scan
    return -horizontal_difference(
        candidates.latitude, candidates.longitude, batch.latitude[t], batch.longitude[t]
    )


@pytest.mark.parametrize("jacobian", [(0.0, 0.0, 0.0, 0.0), (1e-9, 0.0, 1e-5, 1e-4)])
def test_candidates_have_the_value_of_the_reading(rough_map, jacobian):
    batch, _ = make_batch(rough_map, ERROR, jacobian=jacobian, offset=np.full(30, 3e-5))
    batch = replace(batch, reading=batch.reading + 3e-5)
    candidates = contour_candidates(batch, rough_map, ERROR, COVARIANCE, steps=6)
    level = (batch.reading - batch.offset - batch.reading_jacobian @ ERROR)[candidates.scan]
    off = np.abs(rough_map.value(candidates.latitude, candidates.longitude) - level)
    share = np.bincount(candidates.scan, candidates.weight * (off < 1e-8), 30)  # noise is 1e-5
    assert np.median(share) > 0.99
    assert share.mean() > 0.9


def test_weights_are_a_distribution_over_each_scan(rough_map):
    batch, _ = make_batch(rough_map, ERROR)
    candidates = contour_candidates(batch, rough_map, ERROR, COVARIANCE)
    total = np.bincount(candidates.scan, candidates.weight, 30)
    some = total > 0.0  # near an extremum of the map the contour may be out of reach
    assert some.sum() >= 28
    np.testing.assert_allclose(total[some], 1.0, atol=1e-4)
    assert (
        candidates.latitude.shape
        == candidates.longitude.shape
        == candidates.weight.shape
        == candidates.scan.shape
    )
    assert candidates.weight.min() > 0.0
    apart = errors_of(batch, candidates) - ERROR[:2]
    assert (np.abs(apart) < 5.5 * np.sqrt([150.0**2 + 15.0**2, 80.0**2 + 15.0**2])).all()


def test_on_a_plane_they_line_up_along_the_contour():
    """The map rises to the north: contours run east, so the north error is known and the east
    error is not."""
    slope = 3e-8
    plane = field_map_of(lambda north, east: slope * north + 0.0 * east, step=2000.0)
    batch, _ = make_batch(plane, ERROR, seed=None)
    candidates = contour_candidates(batch, plane, np.zeros(4), COVARIANCE)
    apart = errors_of(batch, candidates)
    age = 10.0 * (29 - candidates.scan)
    np.testing.assert_allclose(apart[:, 0], ERROR[0] - age * ERROR[2], atol=1.0)
    assert np.ptp(apart[:, 1]) > 200.0
    nearer = candidates.weight[np.argmin(np.abs(apart[:, 1]))]
    farther = candidates.weight[np.argmax(np.abs(apart[:, 1]))]
    assert nearer > 2.0 * farther


def test_scans_without_a_reading_and_older_ones_have_none(rough_map):
    batch, _ = make_batch(rough_map, ERROR)
    reading = batch.reading.copy()
    reading[[12, 25]] = np.nan
    candidates = contour_candidates(
        replace(batch, reading=reading, new=20), rough_map, ERROR, COVARIANCE
    )
    assert set(candidates.scan) == set(range(10, 30)) - {12, 25}
    assert candidates.scan.dtype == np.int64


def test_flat_or_missing_map_is_no_trouble(rough_map):
    flat = field_map_of(lambda north, east: 0.0 * north + 0.0 * east, step=2000.0)
    batch, _ = make_batch(flat, ERROR)
    assert np.isfinite(contour_candidates(batch, flat, ERROR, COVARIANCE).weight).all()
    values = rough_map.values.copy()
    values[::7, ::5] = np.nan
    batch, _ = make_batch(rough_map, ERROR)
    candidates = contour_candidates(batch, replace(rough_map, values=values), ERROR, COVARIANCE)
    assert np.isfinite(candidates.weight).all()
    assert np.isfinite(candidates.latitude).all()


def test_candidates_are_those_of_newton_steps_in_numpy(rough_map):
    batch, _ = make_batch(rough_map, ERROR)
    got = contour_candidates(batch, rough_map, ERROR, COVARIANCE)
    one = got.scan == 3
    side = np.linspace(-2.0, 2.0, 4)
    seeds = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    spread = batch.transition[3] @ COVARIANCE @ batch.transition[3].T
    centre = batch.transition[3] @ ERROR
    errors = centre + seeds @ np.linalg.cholesky(spread).T
    north, east = metres_per_radian(batch.latitude[3])
    level = (batch.reading - batch.offset - batch.reading_jacobian @ ERROR)[3]
    limit = 2.0 * np.sqrt(np.trace(spread))
    for _ in range(3):
        at = batch.latitude[3] - errors[:, 0] / north, batch.longitude[3] - errors[:, 1] / east
        value, *slope = rough_map.value_and_gradient(*at)
        slope = np.stack(slope, axis=-1)
        step = ((level - value) / (slope**2).sum(axis=1))[:, None] * slope
        errors = errors - np.clip(step, -limit, limit)
    latitude = batch.latitude[3] - errors[:, 0] / north
    apart = np.abs(got.latitude[one][:, None] - latitude).min(axis=1)
    np.testing.assert_allclose(apart * north, 0.0, atol=1e-2)  # the radii are those of the scan
    assert one.sum() > 5
