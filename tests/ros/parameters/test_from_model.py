"""The parameters of a model: types, ranges, descriptions."""

from typing import Literal

import pytest
from pydantic import BaseModel, Field
from rcl_interfaces.msg import ParameterType

from isogal import plugins
from isogal.scenario import Scenario
from isogal_ros.graph.plan import CLASSES, node_class
from isogal_ros.parameters.from_model import limits, parameter_specs


def test_every_parameter_is_typed_and_described() -> None:
    own = [spec for name in CLASSES for spec in node_class(name).specs()]
    for spec in (*parameter_specs(Scenario), *own):
        assert (
            spec.descriptor.dynamic_typing
            or spec.descriptor.type != ParameterType.PARAMETER_NOT_SET
        ), spec.name
        assert spec.descriptor.description, spec.name
    assert all(spec.descriptor.read_only for spec in parameter_specs(Scenario))


def test_ranges_come_from_the_model() -> None:
    specs = {spec.name: spec.descriptor for spec in parameter_specs(Scenario)}
    speed = specs["route.speed"].floating_point_range[0]
    assert (speed.from_value, speed.to_value) == (0.0, 1000.0)
    assert specs["route.speed"].additional_constraints == "> 0"
    length = specs["matcher.batch_length"].integer_range[0]
    assert (length.from_value, length.to_value) == (2, 1000)


def test_names_of_plugins_are_the_allowed_values() -> None:
    (spec,) = [spec for spec in parameter_specs(Scenario) if spec.name == "matcher.name"]
    assert spec.descriptor.additional_constraints == "one of: " + ", ".join(
        plugins.names(plugins.MATCHERS)
    )


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


def test_open_ends_of_a_range_are_the_next_whole_number_or_a_constraint() -> None:
    (ends,) = SPECS["strict"].descriptor.integer_range
    assert (ends.from_value, ends.to_value) == (2, 8)
    assert limits(SPECS["strict"].descriptor) == ">= 2, <= 8"
    (ends,) = SPECS["open"].descriptor.floating_point_range
    assert (ends.from_value, ends.to_value) == (0.0, 0.5)
    assert limits(SPECS["open"].descriptor) == "> 0, < 0.5"


@pytest.mark.parametrize(
    ("name", "field", "parameter"),
    [
        ("strict", 4, 4),
        ("either", "auto", "auto"),
        ("either", 2.0, 2.0),
        ("maybe", None, 0.0),
        ("maybe", 1.5, 1.5),
        ("text", None, ""),
        ("text", "x", "x"),
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


def test_words_beside_a_number_are_named() -> None:
    assert SPECS["either"].descriptor.additional_constraints == "a number >= 0, or auto or off"
