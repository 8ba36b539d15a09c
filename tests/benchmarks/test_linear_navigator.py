"""The linear navigator that others are measured beside is that of the bound."""

import numpy as np
from linear_navigator import linear_navigator, paired

from isogal.evaluation.bound import posterior_cramer_rao
from isogal.fields.scenario_map import maps_for_scenario
from isogal.fusion.measurements.map_reading import MapReading
from isogal.montecarlo.engine import simulate
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory


def beside(*settings):
    """Return the linear navigator of a run, its scenario, trajectory and maps."""
    scenario = load_scenario(None, settings)
    trajectory = build_trajectory(scenario)
    maps, found = maps_for_scenario(scenario, trajectory), []

    def keep(_run, navigator):
        found.append(linear_navigator(scenario, trajectory, maps, navigator))

    simulate(scenario, [0], maps, finished=keep)
    assert len(found) == 1
    return found[0], scenario, trajectory, maps


def test_its_covariance_is_the_bound():
    linear, scenario, trajectory, maps = beside("route.duration=900", "map_error.sigma=3e-5")
    history = linear.history(np.empty(0))
    readings = [one for part in history for one in part.measurements]
    assert len([one for one in readings if isinstance(one, MapReading)]) == 90
    limit = posterior_cramer_rao(scenario.true, trajectory, maps).rms[-1]
    claimed = np.sqrt(np.trace(linear.state.covariance[:2, :2]))
    np.testing.assert_allclose(claimed, limit, rtol=0.02)


def test_the_ratio_to_it_is_of_the_same_runs():
    figures = paired(np.array([4.0, 16.0, 900.0]), np.array([1.0, 4.0]))
    assert figures["paired"] == 2.0 and figures["paired_error"] == 0.0
    assert np.isnan(paired(np.ones(3), np.empty(0))["paired"])
