"""ICCP: the rigid move by hand, far shifts, and noise that hides the contours."""

import numpy as np
import pytest

from helpers.batches import make_batch
from isogal.matching.baselines.iccp import Iccp, _Contours, _iterate


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
