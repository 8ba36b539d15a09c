"""TERCOM: the differences by hand, far shifts, and maps that repeat themselves."""

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.baselines.readings import AssumedNoise, UsableReadings
from isogal.matching.baselines.tercom import Tercom, TercomOptions, _differences


@pytest.mark.parametrize("remove_mean", [False, True])
def test_differences_by_hand(rough_map, remove_mean):
    batch, _ = make_batch(rough_map, (200.0, 0.0, 0.0, 0.0), jacobian=(-8e-9, 0.0, 0.0, 0.0))
    readings = UsableReadings.of(batch, rough_map, AssumedNoise(), whole=True)
    side = np.array([-100.0, 0.0, 250.0]), np.array([-50.0, 30.0])
    absolute, square = _differences(readings.arrays, *side, remove_mean)
    for i, north in enumerate(side[0]):
        for j, east in enumerate(side[1]):
            residual, _ = readings.linearise(rough_map, np.array([north, east, 0.0, 0.0]))
            if remove_mean:
                residual = residual - residual.mean()
            assert absolute[i, j] == pytest.approx(np.abs(residual).mean(), rel=1e-9)
            assert square[i, j] == pytest.approx((residual**2).mean(), rel=1e-9)


@pytest.mark.parametrize("shift", [(1200.0, -900.0), (-2000.0, 700.0)])
def test_finds_a_far_shift(rough_map, shift):
    batch, truth = make_batch(rough_map, (*shift, 0.0, 0.0), sigma=5e-6, prior_sigma=(800.0, 0.02))
    fix, _ = Tercom().match(batch, rough_map, None)
    assert np.hypot(*truth.error_of(fix)) < 40.0
    assert np.sqrt(np.trace(fix.covariance)) < 100.0


def test_a_map_that_repeats_itself_gives_no_fix():
    # waves of 1 km northwards and eastwards: every kilometre fits
    def egg_box(n, e):
        return 2e-5 * (np.sin(2 * np.pi * n / 1000.0) + np.sin(2 * np.pi * e / 1000.0))

    eggs = field_map_of(egg_box, half=20e3, step=100.0)
    batch, _ = make_batch(eggs, prior_sigma=(800.0, 0.02))
    fix, _ = Tercom().match(batch, eggs, None)
    assert fix.reason == "no unique shift of least difference in the search window"
    assert fix.diagnostics["ambiguity"] > 0.5
    narrow, _ = make_batch(eggs, prior_sigma=(80.0, 0.02))
    fix, _ = Tercom().match(narrow, eggs, None)
    assert fix.published


def test_the_grid_is_no_finer_than_its_points_allow(rough_map):
    matcher = Tercom(options=TercomOptions(step=50.0, max_points=41))
    assert len(matcher._side(1000.0)) == 41
    assert len(matcher._side(5000.0)) == 41
    assert np.diff(matcher._side(400.0)).max() == pytest.approx(50.0)
