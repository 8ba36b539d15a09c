"""What the reproduction is made of: its cases, iterations, look-ups and measures along a track."""

import numpy as np

from isogal.earth.ellipsoid import metres_per_radian
from isogal.montecarlo.engine import simulate
from isogal.paper.cases import Plan, Setting
from isogal.paper.iterations import follow_iterations
from isogal.paper.lookups import PROFILE_WINDOW, profile_example, window_example
from isogal.paper.measure import measure_tracks, roughness
from isogal.paper.published import FIGURE_54_READING_SIGMA, ITERATIONS


def test_last_iteration_is_the_fix(two_maps):
    """And recording the batches changes no result."""
    plan = Plan(1, str(two_maps), 900.0)
    snapshots = follow_iterations(plan)
    assert [snapshot.time for snapshot in snapshots] == [150.0 * k for k in range(1, 7)]
    scenario = plan.scenario(Setting(batch_length=15))
    runs = simulate(scenario, [0], plan.field_map(Setting()))
    for index, snapshot in enumerate(snapshots):
        assert snapshot.states.shape == (ITERATIONS + 1, 15, 2)
        assert snapshot.movement.shape == (ITERATIONS,)
        np.testing.assert_allclose(snapshot.states[-1, -1], runs.fix_error[0, index], atol=0.01)
        np.testing.assert_allclose(snapshot.truth[-1], 0.0, atol=1e-6)
        assert abs(snapshot.weight.sum() - 15.0) < 1e-9


def test_profile_has_its_candidates_where_the_map_has_the_reading(two_maps):
    example = profile_example(Plan(2, str(two_maps), 1200.0))
    assert len(example.candidates) >= 2
    there = np.interp(example.candidates, example.offset, example.profile)
    np.testing.assert_allclose(there, example.reading, atol=1e-9)
    assert (np.abs(example.candidates - example.centre) <= PROFILE_WINDOW).all()
    # the waves to the east are 19 km long, the window is 8 km wide
    assert 0.1 < example.ambiguous < 0.5


def test_window_holds_fifty_candidates(two_maps):
    plan = Plan(2, str(two_maps), 1200.0)
    example = window_example(plan)
    assert len(example.candidates) == len(example.weight) == 50
    assert np.abs(example.candidates).max() <= 2500.0
    np.testing.assert_allclose(example.combined, example.weight @ example.candidates)
    field_map = plan.field_map(Setting())
    north, east = (example.candidates / metres_per_radian(example.latitude)).T
    values = field_map.value(example.latitude + north, example.longitude + east)
    assert np.abs(values - example.reading).max() < 10 * FIGURE_54_READING_SIGMA


def test_retrodiction_revises_the_past_and_standard_aiding_does_not(two_maps):
    plan = Plan(3, str(two_maps), 1260.0)
    standard = measure_tracks(plan, Setting(batch_length=15))
    late = measure_tracks(plan, Setting(batch_length=15, mode="retrodiction"))
    np.testing.assert_array_equal(standard.live, standard.revised)
    changed = (late.live != late.revised).any(axis=(0, 2))
    assert changed[1 : 15 * 7].any()
    # after the last batch there is nothing to revise
    np.testing.assert_array_equal(late.live[:, -6:], late.revised[:, -6:])
    assert roughness(late.revised) < roughness(late.live)
