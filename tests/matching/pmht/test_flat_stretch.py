"""A flat stretch and a poor map: the truth may be in the tail of a posterior for an hour, and must
not be forgotten there."""

from isogal.fields.scenario_map import map_for_scenario
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory


def test_the_tail_of_a_wide_posterior_is_not_forgotten():
    """Run 95 of the synthetic map with 8 mGal of map error, whose navigator went 4 km astray while
    it claimed 500 m."""
    scenario = Scenario(
        route={"duration": 9600.0},
        gravimeter={"quantity": "disturbance", "sigma": 1e-6},
        map_error={"sigma": 8e-5},
        matcher={"map_sigma": 8e-5},
        gravity={"field": "normal"},
        map={"continuation": "none"},  # of the map on which that run went astray
    )
    run = simulate(scenario, [95], map_for_scenario(scenario, build_trajectory(scenario)))
    assert run.horizontal_error[0].max() < 2500.0
    assert run.horizontal_error[0][run.elapsed > 8000.0].max() < 500.0
