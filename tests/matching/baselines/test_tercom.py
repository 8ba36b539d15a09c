"""TERCOM: far shifts, and maps that repeat themselves."""

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.baselines.tercom import Tercom


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
