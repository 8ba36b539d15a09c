"""Scenarios as parameter values."""

import pytest
import yaml

from isogal.scenario import Scenario, load_scenario
from isogal_ros.parameters.from_model import parameter_specs
from isogal_ros.parameters.values import (
    node_values,
    parameter_file,
    scenario_from,
    scenario_values,
)


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        ("route.duration=null", "matcher.stride=5", "map.variable=ga", "map.path=x.nc"),
        ("route.waypoints=[[-37, 145, 20], [-36.5, 146, 22.5], [-36, 147, 25]]",),
        ("matcher.map_sigma=auto", "matcher.options={trust: 3, names: [a, b]}"),
        ("matcher.map_sigma=3e-5", "seed=7", "matcher.mode=retrodiction"),
        ("imu.gyroscope.bias=0.01deg/h", "imu.accelerometer.misalignment=[1, 2, 3e-5]"),
        ("imu.grade=tactical", "imu.rate=200", "fusion.rate=2", "imu.grades=null"),
        ("truth.gravimeter.sigma=3x", "truth.imu={grade: quantum}", "truth.gravimeter.bias=1e-5"),
    ],
)
def test_a_scenario_survives_parameters(overrides) -> None:
    scenario = load_scenario(None, overrides)
    specs = {spec.name: spec for spec in parameter_specs(Scenario)}
    values = {
        name: specs[name].to_field(value) for name, value in scenario_values(scenario).items()
    }
    assert set(values) == set(specs)
    assert scenario_from(values, "test") == scenario


def test_a_node_gets_its_sections_and_its_own_settings() -> None:
    values = node_values(Scenario(), {"run": 2}, ("seed", "initial_error"))
    assert {name.partition(".")[0] for name in values} == {"seed", "initial_error", "run"}
    assert values["run"] == 2


def test_a_parameter_file_says_the_scenario_and_what_each_node_has_of_its_own() -> None:
    scenario = load_scenario(None, ["matcher.batch_length=12"])
    document = yaml.safe_load(parameter_file(scenario, {"ins_sim_node": {"rate": 2.0}}))
    assert document["/**"]["ros__parameters"]["matcher"]["batch_length"] == 12
    assert document["/**/ins_sim_node"] == {"ros__parameters": {"rate": 2.0}}
