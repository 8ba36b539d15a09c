import numpy as np

from isogal.paper.cases import Plan, Setting
from isogal.paper.measure import drift_by_theory, measure_tracks, roughness


def test_retrodiction_revises_the_past_and_standard_aiding_does_not(two_maps):
    plan = Plan(3, str(two_maps), 1260.0)
    standard = measure_tracks(plan, Setting(batch_length=15))
    late = measure_tracks(plan, Setting(batch_length=15, mode="retrodiction"))
    np.testing.assert_array_equal(standard.live, standard.revised)
    changed = (late.live != late.revised).any(axis=(0, 2))
    assert changed[1 : 15 * 7].any()
    np.testing.assert_array_equal(
        late.live[:, -6:], late.revised[:, -6:]
    )  # after the last batch there is nothing to revise
    assert roughness(late.revised) < roughness(late.live)


def test_drift_by_theory_ends_with_the_runs(two_maps):
    truth = Plan(1, str(two_maps), 1200.0).scenario(Setting()).true
    assert np.isnan(drift_by_theory(truth, 1300.0))
    assert 70.0 < drift_by_theory(truth, 1200.0) < 400.0
