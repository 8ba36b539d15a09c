"""Scenarios and settings as parameter values by dotted name, and the reverse."""

from collections.abc import Collection, Mapping
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from isogal.errors import InputError
from isogal.scenario import Scenario, describe, validate_scenario
from isogal_ros.parameters.from_model import parameter_specs


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Turn dotted names into nested dictionaries."""
    document: dict[str, Any] = {}
    for name, value in values.items():
        *parents, last = name.split(".")
        target = document
        for parent in parents:
            target = target.setdefault(parent, {})
        target[last] = value
    return document


def scenario_from(values: Mapping[str, Any], where: str) -> Scenario:
    """Return the scenario of model values by dotted name, with defaults for the others; raises
    InputError with one line that begins with `where`."""
    return validate_scenario(nested(values), where)


def settings_from(model: type[BaseModel], values: Mapping[str, Any], where: str) -> Any:
    """Return a node's own settings; raises InputError with one line that begins with `where`."""
    try:
        return model.model_validate(nested(values))
    except ValidationError as error:
        raise InputError(f"{where}: {describe(error, model)}") from None


def scenario_values(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as parameter values; what parameters cannot say is left to its default."""
    values: dict[str, Any] = {}
    for spec in parameter_specs(Scenario):
        item: Any = scenario
        for key in spec.name.split("."):
            item = getattr(item, key)
        value = spec.to_parameter(item)
        if value is not None:
            values[spec.name] = value
    return values


def node_values(
    scenario: Scenario, own: Mapping[str, Any], sections: Collection[str]
) -> dict[str, Any]:
    """Return the parameter values of one node: its sections of the scenario and its own
    settings."""
    values = {
        name: value
        for name, value in scenario_values(scenario).items()
        if name.split(".")[0] in sections
    }
    return values | dict(own)


class _WithoutAliases(yaml.SafeDumper):
    """Writes what is there twice twice: parameter files know no aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def parameter_file(scenario: Scenario, own: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the text of a parameter file for a graph: the scenario for all nodes, and each node's
    own parameters by its name."""
    document = {"/**": {"ros__parameters": nested(scenario_values(scenario))}}
    for name, values in own.items():
        document[f"/**/{name}"] = {"ros__parameters": nested(values)}
    return yaml.dump(document, Dumper=_WithoutAliases, sort_keys=False)
