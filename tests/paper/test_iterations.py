import numpy as np

from isogal.montecarlo.engine import simulate
from isogal.paper.cases import Plan, Setting
from isogal.paper.iterations import BatchRecorder, follow_iterations
from isogal.paper.published import ITERATIONS


def test_last_iteration_is_the_fix(two_maps):
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
        assert len(snapshot.candidates) == len(snapshot.weight) == 15 * 20
        assert abs(snapshot.weight.sum() - 15.0) < 1e-9


def test_recording_batches_changes_no_result(two_maps):
    plan = Plan(1, str(two_maps), 600.0)
    scenario, field_map = plan.scenario(Setting(batch_length=15)), plan.field_map(Setting())
    recorder = BatchRecorder()
    recorded = simulate(scenario, [0], field_map, recorder)
    assert len(recorder.batches) == 4
    np.testing.assert_array_equal(recorded.error, simulate(scenario, [0], field_map).error)
