"""One ROS parameter and the field of a model that it stands for."""

from dataclasses import dataclass
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterDescriptor, ParameterType

from isogal.errors import InputError
from isogal.yaml_text import parse_yaml

UNSAID: Any = object()
"""Of a parameter that cannot say null, or whose field cannot be null."""


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter, whose value is the field's but for null and for arrays, which a model has as
    lists."""

    name: str
    default: Any
    """The parameter's."""
    descriptor: ParameterDescriptor
    null: Any = UNSAID
    """What stands for null."""

    def to_field(self, value: Any) -> Any:
        """Return the model's value for a parameter's value; raises InputError where there is
        none."""
        if isinstance(value, str | int | float):
            return None if value == self.null else value
        return list(value)

    def to_parameter(self, value: Any) -> Any:
        """Return the parameter's value for a model's value; None where a parameter cannot say it,
        so that the default has to stand for it."""
        if value is None:
            return None if self.null is UNSAID else self.null
        return self.cast(value)

    def cast(self, value: Any) -> Any:
        """Turn ints into the doubles that are declared, which rclpy would refuse."""
        if isinstance(value, list | tuple):
            return [float(item) if type(item) is int else item for item in value]
        if self.descriptor.type == ParameterType.PARAMETER_DOUBLE and type(value) is int:
            return float(value)
        return value


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
