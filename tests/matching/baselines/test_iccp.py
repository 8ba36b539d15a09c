"""ICCP: contours of a plane are lines, which gives hand-worked cases; rotation; many starts."""

import numpy as np

from helpers.batches import make_batch
from isogal.matching.baselines.iccp import Iccp


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
