"""Parameters from models, scenarios as parameters, and the files that are made of them."""

from pathlib import Path
from typing import Literal

import pytest
import yaml
from pydantic import BaseModel, Field
from rcl_interfaces.msg import ParameterType

from isogal.scenario import Scenario, load_scenario
from isogal_ros.graph import parameter_reference
from isogal_ros.graph.plan import CLASSES, node_class
from isogal_ros.parameters import bringup_file
from isogal_ros.parameters.from_model import parameter_specs
from isogal_ros.parameters.values import parameter_file, scenario_from, scenario_values


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
    """A field of each kind."""

    strict: int = Field(3, gt=1, lt=9)
    open: float = Field(0.1, gt=0.0, lt=0.5)
    either: float | Literal["auto", "off"] = 0.5
    maybe: float | None = Field(None, gt=0.0)
    text: str | None = None
    texts: tuple[str, ...] = ("a",)
    pair: tuple[float, float] = (1.0, 2.0)
    table: dict[str, float] = Field(default_factory=dict)
    rows: tuple[tuple[float, float], ...] | None = None


SPECS = {spec.name: spec for spec in parameter_specs(Model)}


@pytest.mark.parametrize(
    ("name", "field", "parameter"),
    [
        ("strict", 4, 4),
        ("either", "auto", "auto"),
        ("maybe", None, 0.0),
        ("maybe", 1.5, 1.5),
        ("text", None, ""),
        ("texts", ["a", "b"], ["a", "b"]),
        ("pair", [3.0, 4.0], [3.0, 4.0]),
        ("table", {}, ""),
        ("table", {"a": 1.0}, "{a: 1.0}"),
        ("rows", None, ""),
        ("rows", [[1.0, 2.0]], "[[1.0, 2.0]]"),
    ],
)
def test_values_both_ways(name, field, parameter) -> None:
    assert SPECS[name].to_parameter(field) == parameter
    assert SPECS[name].to_field(parameter) == field


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
    assert scenario_from(values, "test") == scenario


def test_a_parameter_file_says_the_scenario_and_what_each_node_has_of_its_own() -> None:
    scenario = load_scenario(None, ["matcher.batch_length=12"])
    document = yaml.safe_load(parameter_file(scenario, {"ins_sim_node": {"rate": 2.0}}))
    assert document["/**"]["ros__parameters"]["matcher"]["batch_length"] == 12
    assert document["/**/ins_sim_node"] == {"ros__parameters": {"rate": 2.0}}


ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(
    ("made", "file"),
    [
        (bringup_file, "src/isogal_bringup/params/isogal.yaml"),
        (parameter_reference, "docs/parameters.md"),
    ],
)
def test_it_is_up_to_date(made, file) -> None:
    assert (ROOT / file).read_text(encoding="utf-8") == made.text(), (
        f"python -m {made.__name__} > {file}"
    )
