"""Parameters from models, scenarios as parameters, and the files that are made of them."""

from pathlib import Path

import pytest
import yaml
from pydantic import BaseModel, Field
from rcl_interfaces.msg import ParameterType

from isogal.scenario import Scenario, load_scenario, validate_scenario
from isogal_ros.graph import parameter_reference
from isogal_ros.graph.parameter_files import ParameterFile
from isogal_ros.graph.plan import CLASSES, node_class
from isogal_ros.parameters.from_model import limits, parameter_specs
from isogal_ros.parameters.values import nested, parameter_file, scenario_values


def test_every_parameter_is_typed_and_described() -> None:
    own = [spec for name in CLASSES for spec in node_class(name).specs()]
    for spec in (*parameter_specs(Scenario), *own):
        assert (
            spec.descriptor.dynamic_typing
            or spec.descriptor.type != ParameterType.PARAMETER_NOT_SET
        ), spec.name
        assert spec.descriptor.description, spec.name
    assert all(spec.descriptor.read_only for spec in parameter_specs(Scenario))


class Model(BaseModel):
    """Fields with a range."""

    strict: int = Field(3, gt=1, lt=9)
    open: float = Field(0.1, gt=0.0, lt=0.5)


SPECS = {spec.name: spec for spec in parameter_specs(Model)}


def test_open_ends_of_a_range_are_the_next_whole_number_or_a_constraint() -> None:
    (ends,) = SPECS["strict"].descriptor.integer_range
    assert (ends.from_value, ends.to_value) == (2, 8)
    assert limits(SPECS["strict"].descriptor) == ">= 2, <= 8"
    (ends,) = SPECS["open"].descriptor.floating_point_range
    assert (ends.from_value, ends.to_value) == (0.0, 0.5)
    assert limits(SPECS["open"].descriptor) == "> 0, < 0.5"


@pytest.mark.parametrize(
    "overrides",
    [
        ("route.duration=null", "matcher.stride=5", "map.variable=ga", "map.path=x.nc"),
        (
            "route.waypoints=[[-37, 145, 20], [-36.5, 146, 22.5], [-36, 147, 25]]",
            "matcher.map_sigma=auto",
            "imu.gyroscope.bias=0.01deg/h",
            "imu.accelerometer.misalignment=[1, 2, 3e-5]",
        ),
        ("truth.gravimeter.sigma=3x", "truth.imu={grade: quantum}", "imu.grades=null"),
    ],
)
def test_a_scenario_survives_parameters(overrides) -> None:
    scenario = load_scenario(None, overrides)
    options = {"trust": 3, "names": ["a", "b"]}  # of some matcher
    matcher = scenario.matcher.model_copy(update={"options": options})
    scenario = scenario.model_copy(update={"matcher": matcher})
    specs = {spec.name: spec for spec in parameter_specs(Scenario)}
    values = {
        name: specs[name].to_field(value) for name, value in scenario_values(scenario).items()
    }
    assert set(values) == set(specs)
    assert validate_scenario(nested(values), "test") == scenario


def test_a_parameter_file_says_the_scenario_and_what_each_node_has_of_its_own() -> None:
    scenario = load_scenario(None, ["matcher.batch_length=12"])
    document = yaml.safe_load(parameter_file(scenario, {"ins_sim_node": {"rate": 2.0}}))
    assert document["/**"]["ros__parameters"]["matcher"]["batch_length"] == 12
    assert document["/**/ins_sim_node"] == {"ros__parameters": {"rate": 2.0}}


ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("file", ["src/isogal_bringup/params/isogal.yaml", "docs/parameters.md"])
def test_it_is_up_to_date(file) -> None:
    made = parameter_reference.text(of_file=file.endswith("yaml"))
    assert (ROOT / file).read_text(encoding="utf-8") == made, parameter_reference.__doc__


def test_it_says_the_defaults() -> None:
    document = yaml.safe_load(parameter_reference.text(of_file=True))
    file = ParameterFile("the file", {"/**": document["/**"]["ros__parameters"]})
    specs = {spec.name: spec.default for spec in parameter_specs(Scenario)}
    assert file.values("/ukf_fusion_node") == specs
    assert file.scenario("") == Scenario()
