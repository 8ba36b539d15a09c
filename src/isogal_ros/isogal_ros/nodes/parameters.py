"""ROS parameters declared from pydantic models, so that a scenario key is described, typed and
checked in one place.

A nested model becomes dotted names (``matcher.batch_length``). What ROS parameters cannot hold is
written thus:

- a number that may be null is 0 where it is null (such numbers are positive),
- a text that may be null is empty where it is null,
- a number that may also be a word (``matcher.map_sigma: auto``) is dynamically typed,
- anything nested (``route.waypoints``, ``matcher.options``) is a string that holds YAML, empty
  where it is null or has no entries.
"""

import difflib
import math
import sys
import types
import typing
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from isogal import plugins
from isogal.errors import InputError
from isogal.scenario import Scenario, describe, validate_scenario

_OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")


@dataclass(frozen=True)
class ParameterSpec:
    """One ROS parameter and the model field it stands for."""

    name: str
    default: Any
    descriptor: ParameterDescriptor
    kind: str
    """number, nullable, text, nullable_text, array, texts, either or yaml."""
    empty: Any = None
    """What an empty string of YAML stands for."""

    def to_field(self, value: Any) -> Any:
        """Return the model's value for a parameter's value."""
        if self.kind == "nullable":
            return None if value == 0 else value
        if self.kind == "nullable_text":
            return value or None
        if self.kind in ("array", "texts"):
            return list(value)
        if self.kind == "yaml":
            try:
                return yaml.safe_load(value) if value.strip() else self.empty
            except yaml.YAMLError:
                raise InputError(f"parameter {self.name}: must hold YAML, not {value!r}") from None
        return value

    def to_parameter(self, value: Any) -> Any:
        """Return the parameter's value for a model's value; None where the default has to stand
        for it."""
        if self.kind == "nullable":
            return self.default.__class__(0) if value is None else self.cast(value)
        if self.kind == "nullable_text":
            return value or ""
        if self.kind == "array":
            return None if value is None else [float(item) for item in value]
        if self.kind == "yaml":
            return yaml.safe_dump(value, default_flow_style=True).strip() if value else ""
        return self.cast(value)

    def cast(self, value: Any) -> Any:
        """Take an int where a double is declared, which rclpy refuses."""
        if self.descriptor.type == ParameterType.PARAMETER_DOUBLE and type(value) is int:
            return float(value)
        if (
            self.descriptor.type == ParameterType.PARAMETER_DOUBLE_ARRAY
            and isinstance(value, Sequence)
            and not isinstance(value, str)
        ):
            return [float(item) if type(item) is int else item for item in value]
        return value


def parameter_specs(
    model: type[BaseModel],
    prefix: str = "",
    sections: Collection[str] | None = None,
    mutable: Collection[str] = (),
) -> list[ParameterSpec]:
    """List the parameters of a model.

    Parameters
    ----------
    model : type[BaseModel]
        Model whose fields are numbers, texts, tuples, or again models.
    prefix : str
        Put before each name.
    sections : collection of str, optional
        Fields of the top level to take; all where not given.
    mutable : collection of str
        Names that may change at run time; the others are read-only.
    """
    specs: list[ParameterSpec] = []
    for key, info in model.model_fields.items():
        if sections is not None and key not in sections:
            continue
        name = prefix + key
        annotation = info.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            specs += parameter_specs(annotation, f"{name}.", mutable=mutable)
        else:
            specs.append(
                _spec(
                    name,
                    annotation,
                    list(info.metadata),
                    info.get_default(call_default_factory=True),
                    info.description or "",
                    name in mutable,
                    _allowed(info),
                )
            )
    return specs


def _allowed(info: FieldInfo) -> tuple[str, ...]:
    """Return the names of the plugins that a field may have; none where it names no plugin."""
    extra = info.json_schema_extra
    group = extra.get("plugins") if isinstance(extra, dict) else None
    return plugins.names(str(group)) if group else ()


def _spec(
    name: str,
    annotation: Any,
    metadata: list[Any],
    default: Any,
    description: str,
    mutable: bool,
    allowed: tuple[str, ...] = (),
) -> ParameterSpec:
    inner, nullable, metadata = _unwrap(annotation, metadata)
    descriptor = ParameterDescriptor(name=name, description=description, read_only=not mutable)
    if isinstance(inner, tuple):  # number or word
        descriptor.dynamic_typing = True
        descriptor.additional_constraints = f"a number >= 0, or {inner[1]}"
        return ParameterSpec(name, default, descriptor, "either")
    if inner is bool:
        descriptor.type = ParameterType.PARAMETER_BOOL
        return ParameterSpec(name, bool(default), descriptor, "number")
    if inner is float or inner is int:
        low, high = _bounds(metadata, inner)
        if nullable:
            low = inner(0)
            descriptor.additional_constraints = "0 stands for null"
        if inner is int:
            descriptor.type = ParameterType.PARAMETER_INTEGER
            if low is not None or high is not None:
                limits = (-(2**63) if low is None else low, 2**63 - 1 if high is None else high)
                descriptor.integer_range = [
                    IntegerRange(from_value=int(limits[0]), to_value=int(limits[1]), step=0)
                ]
        else:
            descriptor.type = ParameterType.PARAMETER_DOUBLE
            if low is not None or high is not None:
                largest = sys.float_info.max
                limits = (-largest if low is None else low, largest if high is None else high)
                descriptor.floating_point_range = [
                    FloatingPointRange(
                        from_value=float(limits[0]), to_value=float(limits[1]), step=0.0
                    )
                ]
        return ParameterSpec(
            name, inner(default or 0), descriptor, "nullable" if nullable else "number"
        )
    if inner is str or typing.get_origin(inner) is Literal:
        descriptor.type = ParameterType.PARAMETER_STRING
        if words := allowed or typing.get_args(inner):
            descriptor.additional_constraints = "one of: " + ", ".join(words)
        return ParameterSpec(
            name, default or "", descriptor, "nullable_text" if nullable else "text"
        )
    if typing.get_origin(inner) is tuple and typing.get_args(inner)[0] is str:
        descriptor.type = ParameterType.PARAMETER_STRING_ARRAY
        return ParameterSpec(name, list(default), descriptor, "texts")
    if (
        typing.get_origin(inner) is tuple
        and default is not None
        and all(isinstance(item, float | int) for item in default)
    ):
        descriptor.type = ParameterType.PARAMETER_DOUBLE_ARRAY
        descriptor.additional_constraints = f"{len(default)} numbers"
        return ParameterSpec(name, [float(item) for item in default], descriptor, "array")
    descriptor.type = ParameterType.PARAMETER_STRING
    descriptor.additional_constraints = "YAML in a string; empty stands for null"
    text = yaml.safe_dump(default, default_flow_style=True).strip() if default else ""
    return ParameterSpec(name, text, descriptor, "yaml", empty=None if nullable else default)


def _unwrap(annotation: Any, metadata: list[Any]) -> tuple[Any, bool, list[Any]]:
    """Return (bare type, or (float, word) for a number that may be a word; whether null is
    allowed; constraints)."""
    nullable = False
    while True:
        origin = typing.get_origin(annotation)
        if origin is typing.Annotated:
            annotation, *more = typing.get_args(annotation)
            for item in more:
                metadata = metadata + (
                    list(item.metadata) if hasattr(item, "metadata") else [item]
                )
        elif origin in (typing.Union, types.UnionType):
            members = [item for item in typing.get_args(annotation) if item is not type(None)]
            nullable = nullable or len(members) < len(typing.get_args(annotation))
            words = [item for item in members if typing.get_origin(item) is Literal]
            if len(members) == 2 and words:
                return (float, " or ".join(typing.get_args(words[0]))), nullable, metadata
            if len(members) != 1:
                return annotation, nullable, metadata
            annotation = members[0]
        else:
            return annotation, nullable, metadata


def _bounds(metadata: Iterable[Any], number: type) -> tuple[Any, Any]:
    low = high = None
    for item in metadata:
        for attribute in ("ge", "gt", "le", "lt"):
            value = getattr(item, attribute, None)
            if value is None:
                continue
            if attribute in ("gt", "lt"):
                up = attribute == "gt"
                value = (
                    value + (1 if up else -1)
                    if number is int
                    else math.nextafter(value, math.inf if up else -math.inf)
                )
            if attribute[0] == "g":
                low = value if low is None else max(low, value)
            else:
                high = value if high is None else min(high, value)
    return low, high


def declare(
    node: Node, specs: Sequence[ParameterSpec], known: Collection[str] = ()
) -> dict[str, Any]:
    """Declare parameters with their overrides and return their values by name, as the model wants
    them.

    The node must have been made with ``automatically_declare_parameters_from_overrides``: that is
    the public way to see overrides that nobody declares, which rclpy would ignore in silence.

    Parameters
    ----------
    known : collection of str
        Names that are no parameter of this node but may stand in a file that several nodes share.

    Raises
    ------
    InputError
        An override is unknown, has the wrong type or is out of range.
    """
    overrides = {
        name: parameter.value
        for name, parameter in node.get_parameters_by_prefix("").items()
        if not name.startswith(_OF_RCLPY)
    }
    for name in overrides:
        node.undeclare_parameter(name)
    names = {spec.name for spec in specs}
    for name in overrides:
        if name not in names and name not in known:
            close = difflib.get_close_matches(name, [*names, *known], n=1, cutoff=0.5)
            hint = (
                f", did you mean '{close[0]}'?"
                if close
                else f"; allowed: {', '.join(sorted(names))}"
            )
            raise InputError(f"{node.get_name()}: unknown parameter '{name}'{hint}")
    values: dict[str, Any] = {}
    for spec in specs:
        value = spec.cast(overrides.get(spec.name, spec.default))
        try:
            node.declare_parameter(spec.name, value, spec.descriptor, ignore_override=True)
        except InvalidParameterTypeException:
            wanted = Parameter.Type(spec.descriptor.type).name.lower()
            raise InputError(
                f"{node.get_name()}: parameter {spec.name} must be of type {wanted}, not {value!r}"
            ) from None
        except InvalidParameterValueException as error:
            raise InputError(f"{node.get_name()}: parameter {spec.name}: {error}") from None
        try:
            values[spec.name] = spec.to_field(value)
        except InputError as error:
            raise InputError(f"{node.get_name()}: {error}") from None
    node.add_pre_set_parameters_callback(
        lambda parameters: [_recast(parameter, specs) for parameter in parameters]
    )
    return values


def _recast(parameter: Parameter, specs: Sequence[ParameterSpec]) -> Parameter:
    for spec in specs:
        if spec.name == parameter.name:
            return Parameter(parameter.name, value=spec.cast(parameter.value))
    return parameter


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
    """Return the scenario of parameter values; keys that a node has not declared keep their
    defaults."""
    return validate_scenario(nested(values), where)


def settings_from(model: type[BaseModel], values: Mapping[str, Any], where: str) -> Any:
    """Return a node's own settings; raises InputError with one line."""
    try:
        return model.model_validate(nested(values))
    except ValidationError as error:
        raise InputError(f"{where}: {describe(error, model)}") from None


def scenario_values(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as parameter values by dotted name; what parameters cannot say is left to
    its default."""
    values: dict[str, Any] = {}
    for spec in parameter_specs(Scenario):
        item: Any = scenario
        for key in spec.name.split("."):
            item = getattr(item, key)
        value = spec.to_parameter(item)
        if value is not None:
            values[spec.name] = value
    return values


def parameter_file(values: Mapping[str, Any]) -> str:
    """Return the text of a parameter file that every node of a graph reads."""
    return yaml.safe_dump({"/**": {"ros__parameters": nested(values)}}, sort_keys=False)


def on_change(
    node: Node, specs: Sequence[ParameterSpec], apply: typing.Callable[[dict[str, Any]], None]
) -> None:
    """Call `apply` with the new model values of a change; an InputError refuses it and is its
    reason."""
    by_name = {spec.name: spec for spec in specs}

    def callback(parameters: list[Parameter]) -> SetParametersResult:
        try:
            apply(
                {
                    p.name: by_name[p.name].to_field(p.value)
                    for p in parameters
                    if p.name in by_name
                }
            )
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(callback)
