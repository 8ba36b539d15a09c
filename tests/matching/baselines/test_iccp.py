"""ICCP: contours of a plane are lines, which gives hand-worked cases; rotation; many starts."""

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.baselines.iccp import Iccp, _Contours, _crossings, _iterate
from isogal.matching.baselines.readings import AssumedNoise, UsableReadings


def test_contours_of_a_plane_are_straight_lines():
    tilted = field_map_of(lambda n, e: 3e-8 * n + 4e-8 * e)
    batch, _ = make_batch(tilted, seed=None)
    batch.reading[:] += 5e-8 * 250.0  # the contour lies 250 m up the slope
    readings = UsableReadings.of(batch, tilted, AssumedNoise(), whole=True)
    point, tangent, variance, first = _crossings(readings.arrays, 600.0, 20, 1.0)
    np.testing.assert_allclose(point @ [0.6, 0.8], 250.0, atol=1.0)
    np.testing.assert_allclose(np.abs(tangent @ [0.8, -0.6]), 1.0, atol=1e-4)
    np.testing.assert_allclose(variance, (1e-5 / 5e-8) ** 2, rtol=1e-2)
    assert first[0] == 0 and first[-1] == len(point)
    assert (np.diff(first) > 0).all()  # each reading has some


def lines(count, angle):
    """A track northwards and for each of its points two contour lines, one along north, one along
    east, after a rigid move."""
    track = np.stack([200.0 * np.arange(count), np.zeros(count)], axis=1)
    lever = track - track.mean(axis=0)
    moved = np.array([30.0, -40.0]) + angle * np.stack([-lever[:, 1], lever[:, 0]], axis=1)
    along_north = np.arange(count) % 2 == 0
    tangent = np.where(along_north[:, None], [1.0, 0.0], [0.0, 1.0])
    return track, moved, tangent


@pytest.mark.parametrize("angle", [0.0, 0.02])
def test_closest_points_lead_to_the_rigid_move(angle):
    track, point, tangent = lines(20, angle)
    contours = _Contours(point, tangent, np.ones(20), np.arange(21))
    shift, turn, nearest = _iterate(track, contours, np.zeros(2), angle != 0.0, 200, 1e-6)
    np.testing.assert_allclose(shift, [30.0, -40.0], atol=0.01)
    assert turn == pytest.approx(angle, abs=1e-5)
    assert np.array_equal(nearest, np.arange(20))


def test_each_start_goes_to_its_nearest_contour():
    # every reading has two contours, 100 m south and 300 m north of the track
    track = np.stack([np.zeros(10), 200.0 * np.arange(10)], axis=1)
    point = np.tile([[-100.0, 0.0], [300.0, 0.0]], (10, 1))
    tangent = np.tile([0.0, 1.0], (20, 1))
    for start, end in ((0.0, -100.0), (150.0, 300.0)):
        contours = _Contours(point, tangent, np.ones(20), 2 * np.arange(11))
        shift, _, _ = _iterate(track, contours, np.array([start, 0.0]), False, 50, 0.1)
        assert shift[0] == pytest.approx(end)


def test_finds_far_shifts_with_a_good_sensor(rough_map):
    errors = []
    for seed in range(12):
        shift = np.random.default_rng(seed).normal(0.0, 600.0, 2)
        batch, truth = make_batch(
            rough_map,
            (*shift, 0.0, 0.0),
            sigma=2e-6,
            prior_sigma=(600.0, 0.02),
            start=(-20e3 + 3e3 * seed, 4e3),
            seed=seed,
        )
        fix, _ = Iccp().match(batch, rough_map, None)
        errors.append(np.hypot(*truth.error_of(fix)) if fix.published else np.inf)
    assert np.median(errors) < 20.0
    assert sum(error < 100.0 for error in errors) >= 9


def test_matched_contour_points_are_listed(rough_map):
    batch, _ = make_batch(
        rough_map, (60.0, -40.0, 0.0, 0.0), sigma=2e-6, prior_sigma=(100.0, 0.02)
    )
    fix, _ = Iccp().match(batch, rough_map, None)
    value = rough_map.value(fix.candidates.latitude, fix.candidates.longitude)
    np.testing.assert_allclose(value, batch.reading[fix.candidates.scan], atol=3e-6)


def test_noise_wider_than_the_window_gives_no_fix(rough_map):
    batch, _ = make_batch(rough_map, sigma=5e-4)
    fix, _ = Iccp().match(batch, rough_map, None)
    assert "have a contour in the search window" in fix.reason
