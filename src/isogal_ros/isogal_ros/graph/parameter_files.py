"""What a parameter file, or an option of a command line, says to each node of a graph, checked
before the first one starts."""

import re
from collections.abc import Collection, Mapping, Sequence
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

Document = dict[str, dict[str, JsonValue]]
"""Parameters by the pattern of the nodes' names."""


def leaves(document: dict[str, JsonValue], prefix: str = "") -> dict[str, JsonValue]:
    """Return the values of a document by their dotted names."""
    values: dict[str, JsonValue] = {}
    for key, value in document.items():
        if isinstance(value, dict):
            values |= leaves(value, f"{prefix}{key}.")
        else:
            values[f"{prefix}{key}"] = value
    return values


def read_parameters(path: str, where: str) -> Document:
    """Return the sections of a parameter file; raises InputError, which begins with `where`."""
    with reading(where):
        text = Path(path).read_text(encoding="utf-8")
    document = parse_yaml(text, where)
    if not isinstance(document, dict) or not all(
        isinstance(entry, dict) and isinstance(entry.get("ros__parameters"), dict)
        for entry in document.values()
    ):
        raise InputError(f"{where}: must map names of nodes, or /**, to ros__parameters")
    return {str(name): entry["ros__parameters"] for name, entry in document.items()}


def values_of(document: Document, full_name: str) -> dict[str, JsonValue]:
    """Return what a file says to a node, by dotted name; what comes later counts."""
    values: dict[str, JsonValue] = {}
    for pattern, parameters in document.items():
        if _matches(pattern, full_name):
            values |= leaves(parameters)
    return {name: value for name, value in values.items() if not name.startswith(OF_RCLPY)}


def scenario_of(
    document: Document, full_name: str, where: str, keys: Mapping[str, JsonValue] | None = None
) -> Scenario:
    """Return the scenario that a file gives a node, whatever sections it has; raises InputError.

    Parameters
    ----------
    document : Document
    full_name : str
        The node's name with its namespace.
    where : str
        What the line of an error begins with.
    keys : mapping, optional
        Parameters that count before those of the file.
    """
    specs = parameter_specs(Scenario)
    sections = {spec.name.partition(".")[0] for spec in specs}
    values = values_of(document, full_name) | dict(keys or {})
    own = {name: value for name, value in values.items() if name.partition(".")[0] in sections}
    try:
        found = fields_of(known_values(own, specs), specs)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return validate_scenario(nested(found), where)


def full_name(namespace: str, name: str) -> str:
    """Return a node's name with its namespace."""
    return f"/{namespace.strip('/')}/{name}".replace("//", "/")


def check_node(document: Document, name: str, full: str, where: str) -> None:
    """Raise InputError where a file gives a node what it would refuse.

    Parameters
    ----------
    document : Document
    name, full : str
        The node's name, without and with its namespace.
    where : str
        What the line begins with.
    """
    kind = node_class(name)
    specs = kind.specs()
    try:
        found = fields_of(known_values(values_of(document, full), specs, KEYS), specs)
    except InputError as error:
        raise InputError(f"{where}: {name}: {error}") from None
    kind.read(f"{where}: {name}", found)


def unmatched_sections(document: Document, names: Collection[str], namespace: str) -> list[str]:
    """Say which sections of a file are for none of some nodes in a namespace."""
    full = [full_name(namespace, name) for name in names]
    return [
        f"section {pattern} is for no node of the graph{nearest(pattern, full, 0.8)}"
        for pattern in document
        if not any(_matches(pattern, name) for name in full)
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
