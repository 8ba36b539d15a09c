"""One ROS parameter and the field of a model that it stands for."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterDescriptor, ParameterType

from isogal.errors import InputError
from isogal.yaml_text import parse_yaml


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter whose value is the field's."""

    name: str
    default: Any
    """The parameter's."""
    descriptor: ParameterDescriptor

    def to_field(self, value: Any) -> Any:
        """Return the model's value for a parameter's value; raises InputError where there is
        none."""
        return value

    def to_parameter(self, value: Any) -> Any:
        """Return the parameter's value for a model's value; None where a parameter cannot say it,
        so that the default has to stand for it."""
        return self.cast(value)

    def cast(self, value: Any) -> Any:
        """Turn an int into the double that is declared, which rclpy would refuse."""
        if self.descriptor.type == ParameterType.PARAMETER_DOUBLE and type(value) is int:
            return float(value)
        return value


class NullableNumber(ParameterSpec):
    """A positive number; 0 stands for null."""

    def to_field(self, value: Any) -> Any:
        """Return None for 0."""
        return None if value == 0 else value

    def to_parameter(self, value: Any) -> Any:
        """Return 0 for None."""
        return self.default.__class__(0) if value is None else self.cast(value)


class NullableText(ParameterSpec):
    """A text; an empty one stands for null."""

    def to_field(self, value: Any) -> Any:
        """Return None for an empty text."""
        return value or None

    def to_parameter(self, value: Any) -> Any:
        """Return an empty text for None."""
        return value or ""


class Texts(ParameterSpec):
    """An array of texts."""

    def to_field(self, value: Any) -> Any:
        """Return a list."""
        return list(value)


class Numbers(ParameterSpec):
    """An array of numbers."""

    def to_field(self, value: Any) -> Any:
        """Return a list."""
        return list(value)

    def to_parameter(self, value: Any) -> Any:
        """Return a list of doubles; None for None."""
        return None if value is None else [float(item) for item in value]

    def cast(self, value: Any) -> Any:
        """Turn ints of a list into doubles."""
        if isinstance(value, Sequence) and not isinstance(value, str):
            return [float(item) if type(item) is int else item for item in value]
        return value


class Quantity(ParameterSpec):
    """One value or three, numbers or texts with a unit; an empty text stands for null."""

    def to_field(self, value: Any) -> Any:
        """Return None for an empty text, a list for an array."""
        if isinstance(value, str | int | float):
            return None if value == "" else value
        return list(value)

    def to_parameter(self, value: Any) -> Any:
        """Return an empty text for None, an array of doubles for three numbers."""
        return "" if value is None else [float(item) for item in value]


@dataclass(frozen=True)
class Yaml(ParameterSpec):
    """A text that holds YAML."""

    empty: Any = None
    """What an empty text stands for."""

    def to_field(self, value: Any) -> Any:
        """Return what the YAML says."""
        try:
            return parse_yaml(value, self.name) if value.strip() else self.empty
        except InputError:
            raise InputError(f"parameter {self.name}: must hold YAML, not {value!r}") from None

    def to_parameter(self, value: Any) -> Any:
        """Return YAML in one line; an empty text for what has no entries."""
        return yaml_line(value)


def yaml_line(value: Any) -> str:
    """Return a value as YAML in one line; an empty text for None and for what has no entries."""
    return yaml.safe_dump(value, default_flow_style=True).strip() if value else ""
