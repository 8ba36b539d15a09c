"""The parameters of a pydantic model."""

import sys
import typing
from collections.abc import Collection, Sequence
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
)

from isogal import plugins
from isogal_ros.parameters.annotations import Content, content_of
from isogal_ros.parameters.spec import UNSAID, ParameterSpec, Yaml, yaml_line


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
    for key, field in model.model_fields.items():
        if sections is not None and key not in sections:
            continue
        name, annotation = prefix + key, field.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            specs += parameter_specs(annotation, f"{name}.", mutable=mutable)
        else:
            descriptor = ParameterDescriptor(
                name=name, description=field.description or "", read_only=name not in mutable
            )
            specs.append(_spec(field, descriptor))
    return specs


def _spec(field: FieldInfo, descriptor: ParameterDescriptor) -> ParameterSpec:
    """Return the parameter of a field; completes its descriptor."""
    content, default = content_of(field), field.get_default(call_default_factory=True)
    kind = content.type
    if (quantity := _extra(field, "quantity")) is not None:
        descriptor.dynamic_typing = True
        descriptor.additional_constraints = f"{quantity}, or three of them; empty stands for null"
        return ParameterSpec(descriptor.name, "", descriptor, null="")
    if content.words:
        descriptor.dynamic_typing = True
        descriptor.additional_constraints = f"a number >= 0, or {' or '.join(content.words)}"
        return ParameterSpec(descriptor.name, default, descriptor)
    if kind is bool:
        descriptor.type = ParameterType.PARAMETER_BOOL
        return ParameterSpec(descriptor.name, bool(default), descriptor)
    if kind is float or kind is int:
        return _number(content, default, descriptor)
    if kind is str or typing.get_origin(kind) is Literal:
        return _text(content, default, descriptor, _plugins(field) or typing.get_args(kind))
    if typing.get_origin(kind) is tuple and typing.get_args(kind)[0] is str:
        descriptor.type = ParameterType.PARAMETER_STRING_ARRAY
        return ParameterSpec(descriptor.name, list(default), descriptor)
    if (
        typing.get_origin(kind) is tuple
        and default is not None
        and all(isinstance(item, float | int) for item in default)
    ):
        descriptor.type = ParameterType.PARAMETER_DOUBLE_ARRAY
        descriptor.additional_constraints = f"{len(default)} numbers"
        return ParameterSpec(descriptor.name, [float(item) for item in default], descriptor)
    descriptor.type = ParameterType.PARAMETER_STRING
    descriptor.additional_constraints = "YAML in a string; empty stands for null"
    empty = None if content.nullable else default
    return Yaml(descriptor.name, yaml_line(default), descriptor, empty=empty)


def _number(content: Content, default: Any, descriptor: ParameterDescriptor) -> ParameterSpec:
    low, high = content.bounds()
    if content.nullable:
        low = content.type(0)
        descriptor.additional_constraints = "0 stands for null"
    descriptor.type = (
        ParameterType.PARAMETER_INTEGER if content.type is int else ParameterType.PARAMETER_DOUBLE
    )
    if low is not None or high is not None:
        _limit(descriptor, low, high)
    zero = content.type(0)
    null = zero if content.nullable else UNSAID
    return ParameterSpec(descriptor.name, content.type(default or zero), descriptor, null)


def _limit(descriptor: ParameterDescriptor, low: Any, high: Any) -> None:
    """Write the range of a number; None = the end of what the type can hold."""
    if descriptor.type == ParameterType.PARAMETER_INTEGER:
        ends = (-(2**63) if low is None else int(low), 2**63 - 1 if high is None else int(high))
        descriptor.integer_range = [IntegerRange(from_value=ends[0], to_value=ends[1], step=0)]
    else:
        largest = sys.float_info.max
        span = (-largest if low is None else float(low), largest if high is None else float(high))
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=span[0], to_value=span[1], step=0.0)
        ]


def _text(
    content: Content, default: Any, descriptor: ParameterDescriptor, allowed: Sequence[str]
) -> ParameterSpec:
    descriptor.type = ParameterType.PARAMETER_STRING
    if allowed:
        descriptor.additional_constraints = "one of: " + ", ".join(allowed)
    null = "" if content.nullable else UNSAID
    return ParameterSpec(descriptor.name, default or "", descriptor, null)


def _plugins(field: FieldInfo) -> tuple[str, ...]:
    """Return the names of the plugins that a field may have; none where it names no plugin."""
    group = _extra(field, "plugins")
    return plugins.names(group) if group else ()


def _extra(field: FieldInfo, key: str) -> str | None:
    """Return what a field says of itself beside its type."""
    extra = field.json_schema_extra
    found = extra.get(key) if isinstance(extra, dict) else None
    return None if found is None else str(found)
