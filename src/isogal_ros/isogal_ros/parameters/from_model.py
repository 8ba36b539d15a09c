"""The parameters of a pydantic model, from its JSON schema."""

import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from math import inf, isfinite
from typing import Any

import yaml
from pydantic import BaseModel, JsonValue, TypeAdapter
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
)

from isogal import plugins
from isogal.errors import InputError
from isogal.yaml_text import parse_yaml

Schema = Mapping[str, Any]
"""JSON schema, of a model or of a field."""

_ANYTHING = TypeAdapter(Any)


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter, whose value is that of a model's field but for null, and for what is nested."""

    name: str
    default: JsonValue
    """The parameter's."""
    descriptor: ParameterDescriptor
    null: str | float | None = None
    """What stands for null; None = the parameter cannot say it."""
    is_yaml: bool = False
    """Whether it is a text that holds YAML."""
    empty: JsonValue = None
    """What an empty text stands for, where it is YAML."""

    def to_field(self, value: Any) -> JsonValue:
        """Return the model's value for a parameter's value; raises InputError where there is
        none."""
        if self.is_yaml:
            try:
                found: JsonValue = parse_yaml(value, self.name) if value.strip() else self.empty
            except (InputError, AttributeError):
                raise InputError(f"parameter {self.name}: must hold YAML, not {value!r}") from None
            return found
        if isinstance(value, str | int | float):
            return None if self.null is not None and value == self.null else value
        return list(value)

    def to_parameter(self, value: JsonValue) -> JsonValue:
        """Return the parameter's value for a model's value; None where a parameter cannot say it,
        so that the default has to stand for it."""
        if self.is_yaml:
            return yaml_line(value)
        return self.null if value is None else self.cast(value)

    def cast(self, value: JsonValue) -> JsonValue:
        """Turn ints into the doubles that are declared, which rclpy would refuse."""
        if isinstance(value, list | tuple):
            return [float(item) if type(item) is int else item for item in value]
        if self.descriptor.type == ParameterType.PARAMETER_DOUBLE and type(value) is int:
            return float(value)
        return value


def yaml_line(value: JsonValue) -> str:
    """Return a value as YAML in one line; an empty text for None and for what has no entries."""
    plain = _ANYTHING.dump_python(value)  # of sections in a list their keys
    return yaml.safe_dump(plain, default_flow_style=True, width=inf).strip() if value else ""


def parameter_specs(
    model: type[BaseModel],
    sections: Collection[str] | None = None,
    mutable: Collection[str] = (),
) -> list[ParameterSpec]:
    """List the parameters of a model.

    Parameters
    ----------
    model : type[BaseModel]
        Model whose fields are numbers, texts, tuples, or again models.
    sections : collection of str, optional
        Fields of the top level to take; all where not given.
    mutable : collection of str
        Names that may change at run time; the others are read-only.
    """
    return [
        _spec(name, field, name not in mutable)
        for name, field in _fields(model)
        if sections is None or name.partition(".")[0] in sections
    ]


@cache
def _fields(model: type[BaseModel], prefix: str = "") -> list[tuple[str, Schema]]:
    """Return the JSON schema of each field by its dotted name, with the default of the model,
    which may be no JSON (NaN)."""
    properties = model.model_json_schema()["properties"]
    found: list[tuple[str, Schema]] = []
    for key, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            found += _fields(field.annotation, f"{prefix}{key}.")
        else:
            default = field.get_default(call_default_factory=True)
            found.append((prefix + key, properties[key] | {"default": default}))
    return found


def _spec(name: str, field: Schema, read_only: bool) -> ParameterSpec:
    """Return the parameter of a field."""
    descriptor = ParameterDescriptor(
        name=name, description=" ".join(field.get("description", "").split()), read_only=read_only
    )
    choices = [one for one in field.get("anyOf", [field]) if one.get("type") != "null"]
    nullable = len(choices) < len(field.get("anyOf", [field]))
    default, content = field["default"], choices[0] if len(choices) == 1 else {}
    words = next((_words(one) for one in choices[1:] if _words(one)), ())
    if "quantity" in field:
        descriptor.dynamic_typing = True
        descriptor.additional_constraints = (
            f"{field['quantity']}, or three of them; empty stands for null"
        )
        return ParameterSpec(name, "", descriptor, null="")
    if len(choices) == 2 and words:
        descriptor.dynamic_typing = True
        descriptor.additional_constraints = f"a number >= 0, or {' or '.join(words)}"
        return ParameterSpec(name, default, descriptor)
    match content.get("type"):
        case "boolean":
            descriptor.type = ParameterType.PARAMETER_BOOL
            return ParameterSpec(name, bool(default), descriptor)
        case "integer" | "number":
            return _number(content, default, descriptor, nullable)
        case "string":
            group = field.get("plugins")
            allowed = plugins.names(group) if group else _words(content)
            descriptor.type = ParameterType.PARAMETER_STRING
            descriptor.additional_constraints = (allowed and "one of: " + ", ".join(allowed)) or ""
            return ParameterSpec(name, default or "", descriptor, "" if nullable else None)
        case "array" if content.get("items", {}).get("type") == "string":
            descriptor.type = ParameterType.PARAMETER_STRING_ARRAY
            return ParameterSpec(name, list(default), descriptor)
        case "array" if default and all(isinstance(item, float | int) for item in default):
            descriptor.type = ParameterType.PARAMETER_DOUBLE_ARRAY
            descriptor.additional_constraints = f"{len(default)} numbers"
            return ParameterSpec(name, [float(item) for item in default], descriptor)
    descriptor.type = ParameterType.PARAMETER_STRING
    descriptor.additional_constraints = "YAML in a string; empty stands for null"
    empty = None if nullable else default
    return ParameterSpec(name, yaml_line(default), descriptor, is_yaml=True, empty=empty)


def limits(descriptor: ParameterDescriptor) -> str:
    """Return a numeric parameter's range in words; empty where it has none."""
    open_ends = descriptor.additional_constraints
    for item in (*descriptor.floating_point_range, *descriptor.integer_range):
        low, high = item.from_value, item.to_value
        largest = sys.float_info.max if isinstance(low, float) else 2**63 - 1
        lower = f"> {low:g}" if f"> {low:g}" in open_ends else f">= {low:g}"
        upper = f"< {high:g}" if f"< {high:g}" in open_ends else f"<= {high:.12g}"
        return f"{lower}, {upper}" if high < largest else lower
    return ""


def _words(field: Schema) -> tuple[str, ...]:
    """Return the words that a field may be; none where it may be any text."""
    return tuple(field.get("enum", [field["const"]] if "const" in field else []))


def _number(
    content: Schema, default: float | None, descriptor: ParameterDescriptor, nullable: bool
) -> ParameterSpec:
    """Return the parameter of a number; completes its descriptor. A range of ROS includes its
    ends: one that the model leaves out is the next whole number, or else a constraint beside."""
    whole = content["type"] == "integer"
    kind, step, largest = (int, 1, 2**63 - 1) if whole else (float, 0.0, sys.float_info.max)
    above, below = content.get("exclusiveMinimum", -inf), content.get("exclusiveMaximum", inf)
    low = max(content.get("minimum", -inf), above + step)
    high = min(content.get("maximum", inf), below - step)
    left_out = [f"> {above:g}"] if isfinite(above) and low == above else []
    left_out += [f"< {below:g}"] if isfinite(below) and high == below else []
    if nullable:
        low, left_out = 0, ["0 stands for null"]
    descriptor.additional_constraints = ", ".join(left_out)
    descriptor.type = ParameterType.PARAMETER_INTEGER if whole else ParameterType.PARAMETER_DOUBLE
    if isfinite(low) or isfinite(high):
        ends = kind(max(low, -largest)), kind(min(high, largest))
        limits = (IntegerRange if whole else FloatingPointRange)(
            from_value=ends[0], to_value=ends[1]
        )
        setattr(descriptor, "integer_range" if whole else "floating_point_range", [limits])
    null = kind(0) if nullable else None
    return ParameterSpec(descriptor.name, kind(default or 0), descriptor, null)
