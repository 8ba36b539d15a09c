"""What a parameter file, or an option of a command line, says to each node of a graph, checked
before the first one starts."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import JsonValue
from rcl_interfaces.msg import ParameterType

from isogal.errors import InputError, nearest
from isogal.files import reading
from isogal.scenario import Scenario, validate_scenario, validated
from isogal.yaml_text import parse_yaml
from isogal_ros import topics
from isogal_ros.graph.plan import node_class
from isogal_ros.nodes.base import KEYS
from isogal_ros.nodes.settings import NodeSettings
from isogal_ros.parameters.declaration import OF_RCLPY, fields_of, known_values
from isogal_ros.parameters.from_model import ParameterSpec, parameter_specs
from isogal_ros.parameters.values import nested


def leaves(document: dict[str, JsonValue], prefix: str = "") -> dict[str, JsonValue]:
    """Return the values of a document by their dotted names."""
    values: dict[str, JsonValue] = {}
    for key, value in document.items():
        if isinstance(value, dict):
            values |= leaves(value, f"{prefix}{key}.")
        else:
            values[f"{prefix}{key}"] = value
    return values


@dataclass(frozen=True)
class ParameterFile:
    """What a parameter file says. What is raised is an InputError that begins with `where`."""

    where: str
    sections: Mapping[str, dict[str, JsonValue]]
    """Parameters by the pattern of the nodes' names."""

    @classmethod
    def read(cls, path: str, where: str) -> "ParameterFile":
        """Read a file."""
        with reading(where):
            text = Path(path).read_text(encoding="utf-8")
        document = parse_yaml(text, where)
        if not isinstance(document, dict) or not all(
            isinstance(entry, dict) and isinstance(entry.get("ros__parameters"), dict)
            for entry in document.values()
        ):
            raise InputError(f"{where}: must map names of nodes, or /**, to ros__parameters")
        found = {str(name): entry["ros__parameters"] for name, entry in document.items()}
        return cls(where, found)

    @property
    def of_all(self) -> "ParameterFile":
        """What it says to all nodes."""
        return replace(self, sections={"/**": self.sections.get("/**", {})})

    def values(self, full_name: str) -> dict[str, JsonValue]:
        """Return what it says to a node, by dotted name; what comes later counts."""
        values: dict[str, JsonValue] = {}
        for pattern, parameters in self.sections.items():
            if _matches(pattern, full_name):
                values |= leaves(parameters)
        return {name: value for name, value in values.items() if not name.startswith(OF_RCLPY)}

    def scenario(self, full_name: str, keys: Mapping[str, JsonValue] | None = None) -> Scenario:
        """Return the scenario that it gives a node, whatever sections it has; `keys` are
        parameters that count before its own."""
        specs = parameter_specs(Scenario)
        sections = {spec.name.partition(".")[0] for spec in specs}
        values = self.values(full_name) | dict(keys or {})
        own = {name: value for name, value in values.items() if name.partition(".")[0] in sections}
        return validate_scenario(nested(self._fields(own, specs)), self.where)

    def check_node(self, name: str, full_name: str) -> None:
        """Raise InputError where it gives a node what that would refuse."""
        kind = node_class(name)
        kind.read(self.where, self._fields(self.values(full_name), kind.specs(), KEYS))

    def _fields(
        self,
        values: dict[str, JsonValue],
        specs: Sequence[ParameterSpec],
        others: Collection[str] = (),
    ) -> dict[str, JsonValue]:
        try:
            return fields_of(known_values(values, specs, others), specs)
        except InputError as error:
            raise InputError(f"{self.where}: {error}") from None

    def unmatched(self, full_names: Collection[str]) -> list[str]:
        """Say which sections are for none of some nodes."""
        return [
            f"section {pattern} is for no node of the graph{nearest(pattern, full_names, 0.8)}"
            for pattern in self.sections
            if not any(_matches(pattern, name) for name in full_names)
        ]


def filter_parameters(texts: Sequence[str]) -> dict[str, JsonValue]:
    """Return own parameters of the filter's node by name from ``NAME=VALUE``, values in YAML.

    Raises
    ------
    InputError
        The node has no such parameter, or none of that value; the line names it.
    """
    model = node_class(topics.UKF_FUSION).settings_model
    own = [s for s in parameter_specs(model) if s.name not in NodeSettings.model_fields]
    found = given_parameters("--parameter", texts, own)
    validated(model, nested(found), where="--parameter: ")
    return found


def given_parameters(
    option: str, texts: Sequence[str], specs: Sequence[ParameterSpec]
) -> dict[str, JsonValue]:
    """Return parameters by name from texts ``NAME=VALUE``, values in YAML, that an option gives;
    raises InputError where a text has another form, or names none of the parameters."""
    names, found = {spec.name: spec for spec in specs}, {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"{option}: must be NAME=VALUE, not {text!r}")
        if name not in names:
            raise InputError(f"{option} {name}: no such parameter{nearest(name, names)}")
        is_text = names[name].descriptor.type == ParameterType.PARAMETER_STRING
        content = value if is_text else parse_yaml(value, f"{option} {name}")
        found[name] = names[name].cast(content)
    return found


def _matches(pattern: str, full_name: str) -> bool:
    """Whether a section of a parameter file is a node's: ``*`` stands for one part of its name,
    ``**`` for any number."""
    wild = {"*": "/[^/]+", "**": "(/[^/]+)*"}
    parts = (wild.get(part, f"/{re.escape(part)}") for part in pattern.strip("/").split("/"))
    return re.fullmatch("".join(parts), full_name) is not None
