from pathlib import Path

import numpy as np
import pytest

from helpers.navigators import start_of
from isogal.evaluation.consistency import spread_test
from isogal.fusion.assumed import filter_model
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.montecarlo.engine import simulate_unaided
from isogal.paper.cases import Plan, Setting
from isogal.paper.measure import drift_by_theory, measure_tracks, roughness
from isogal.scenario import validate_scenario
from isogal.scenario.imu_grades import PAPER_GRADES
from isogal.sensors.imu import simulate_imu
from isogal.sensors.trajectory import build_trajectory


@pytest.mark.parametrize("grade", PAPER_GRADES)
def test_spread_of_the_unaided_ins_is_that_of_its_filter(grade: str) -> None:
    """100 full strapdown runs against the unscented filter's own covariance, chi-square interval
    of 99 % for all instants together."""
    scenario = validate_scenario({"imu": {"grade": grade}})
    trajectory = build_trajectory(scenario)
    runs = range(100)
    imu = simulate_imu(scenario, trajectory, runs)
    error = simulate_unaided(scenario, runs, trajectory, imu)
    model = filter_model(scenario)
    state = FilterState.start(start_of(scenario, trajectory), model)
    claimed, done = [], 0
    instants = [1800, 3600, 7200, 10800, 12600]
    for k in instants:
        part = slice(done, k)
        propagate(
            state,
            model,
            imu.specific_force[0, part],
            imu.angular_rate[0, part],
            trajectory.height[done + 1 : k + 1],
        )
        claimed.append(state.covariance[:2, :2].copy())
        done = k
    scans = [k // scenario.steps_per_scan for k in instants]
    test = spread_test(error[:, scans], np.array(claimed), confidence=0.99)
    assert test.consistent, test.nees


def test_retrodiction_revises_the_past_and_standard_aiding_does_not(two_maps: Path) -> None:
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


def test_drift_by_theory_ends_with_the_runs(two_maps: Path) -> None:
    scenario = Plan(1, str(two_maps), 1200.0).scenario(Setting())
    assert np.isnan(drift_by_theory(scenario, 1300.0))
    assert 70.0 < drift_by_theory(scenario, 1200.0) < 400.0
