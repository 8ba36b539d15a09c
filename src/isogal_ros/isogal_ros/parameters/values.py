"""Scenarios and settings as parameter values by dotted name, and the reverse."""

from collections.abc import Collection, Mapping
from operator import attrgetter

import yaml
from pydantic import JsonValue

from isogal.scenario import Scenario
from isogal_ros.parameters.from_model import parameter_specs

Values = dict[str, JsonValue]
"""Values by dotted name."""


def nested(values: Mapping[str, JsonValue]) -> Values:
    """Turn dotted names into nested dictionaries."""
    document: Values = {}
    for name, value in values.items():
        *parents, last = name.split(".")
        target = document
        for parent in parents:
            inner = target.setdefault(parent, {})
            assert isinstance(inner, dict)  # no parameter has the name of a section
            target = inner
        target[last] = value
    return document


def scenario_values(scenario: Scenario) -> Values:
    """Return a scenario as parameter values; what parameters cannot say is left to its default."""
    values = {
        spec.name: spec.to_parameter(attrgetter(spec.name)(scenario))
        for spec in parameter_specs(Scenario)
    }
    return {name: value for name, value in values.items() if value is not None}


def node_values(
    scenario: Scenario, own: Mapping[str, JsonValue], sections: Collection[str]
) -> Values:
    """Return the parameter values of one node: its sections of the scenario and its own
    settings."""
    values = {
        name: value
        for name, value in scenario_values(scenario).items()
        if name.split(".")[0] in sections
    }
    return values | dict(own)


_Dumper = type(
    "_Dumper",
    (getattr(yaml, "CSafeDumper", yaml.SafeDumper),),
    {"ignore_aliases": lambda _self, _data: True},
)
"""Writes what is there twice twice: neither parameter files nor rosbag2 know aliases."""


def yaml_text(value: JsonValue) -> str:
    """Return YAML without aliases, and without breaks in long texts."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, width=1000)


def parameter_file(scenario: Scenario, own: Mapping[str, Mapping[str, JsonValue]]) -> str:
    """Return the text of a parameter file for a graph: the scenario for all nodes, and each node's
    own parameters by its name."""
    document: Values = {"/**": {"ros__parameters": nested(scenario_values(scenario))}}
    for name, values in own.items():
        document[f"/**/{name}"] = {"ros__parameters": nested(values)}
    return yaml_text(document)
