"""Parameters declared on a node, and changed while it runs."""

import difflib
from collections.abc import Callable, Collection, Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from isogal.errors import InputError
from isogal_ros.parameters.spec import ParameterSpec, yaml_line
from isogal_ros.parameters.values import nested

OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare(
    node: Node, specs: Sequence[ParameterSpec], known: Collection[str] = ()
) -> dict[str, Any]:
    """Declare parameters with the overrides of the command line and parameter files; return their
    values by name, as the model wants them.

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
        if not name.startswith(OF_RCLPY)
    }
    for name in overrides:
        node.undeclare_parameter(name)
    try:
        overrides = known_overrides(overrides, specs, known)
        values = {spec.name: _declare(node, spec, overrides) for spec in specs}
    except InputError as error:
        raise InputError(f"{node.get_name()}: {error}") from None
    node.add_pre_set_parameters_callback(
        lambda parameters: [_recast(parameter, specs) for parameter in parameters]
    )
    return values


def known_overrides(
    overrides: dict[str, Any], specs: Sequence[ParameterSpec], known: Collection[str] = ()
) -> dict[str, Any]:
    """Return overrides by the names of parameters; raises InputError for one that neither is a
    parameter nor `known`, see `declare`."""
    names = {spec.name for spec in specs}
    folded = _folded(overrides, names | set(known))
    _require_known(folded, names, known)
    return folded


def on_change(
    node: Node, specs: Sequence[ParameterSpec], apply: Callable[[dict[str, Any]], None]
) -> None:
    """Call `apply` with the new model values of a change; an InputError refuses it and is its
    reason."""
    by_name = {spec.name: spec for spec in specs}

    def callback(parameters: list[Parameter]) -> SetParametersResult:
        known = [parameter for parameter in parameters if parameter.name in by_name]
        try:
            apply({item.name: by_name[item.name].to_field(item.value) for item in known})
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(callback)


def _folded(overrides: dict[str, Any], names: Collection[str]) -> dict[str, Any]:
    """Return overrides with those inside a parameter that holds YAML (``truth.imu.grade``, as a
    parameter file with nested keys has it) put together as its text."""
    kept: dict[str, Any] = {}
    parts: dict[str, dict[str, Any]] = {}
    for name, value in overrides.items():
        outer = next((key for key in names if name.startswith(f"{key}.")), None)
        if outer is None or outer in overrides:
            kept[name] = value
        else:
            parts.setdefault(outer, {})[name.removeprefix(f"{outer}.")] = value
    return kept | {outer: yaml_line(nested(part)) for outer, part in parts.items()}


def _require_known(
    overrides: Collection[str], names: Collection[str], known: Collection[str]
) -> None:
    for name in overrides:
        if name not in names and name not in known:
            close = difflib.get_close_matches(name, [*names, *known], n=1, cutoff=0.5)
            hint = (
                f", did you mean '{close[0]}'?"
                if close
                else f"; allowed: {', '.join(sorted(names))}"
            )
            raise InputError(f"unknown parameter '{name}'{hint}")


def _declare(node: Node, spec: ParameterSpec, overrides: dict[str, Any]) -> Any:
    """Declare one parameter; return its value as the model wants it."""
    value = spec.cast(overrides.get(spec.name, spec.default))
    try:
        node.declare_parameter(spec.name, value, spec.descriptor, ignore_override=True)
    except InvalidParameterTypeException:
        wanted = Parameter.Type(spec.descriptor.type).name.lower()
        raise InputError(
            f"parameter {spec.name} must be of type {wanted}, not {value!r}"
        ) from None
    except InvalidParameterValueException as error:
        raise InputError(f"parameter {spec.name}: {error}") from None
    return spec.to_field(value)


def _recast(parameter: Parameter, specs: Sequence[ParameterSpec]) -> Parameter:
    for spec in specs:
        if spec.name == parameter.name:
            return Parameter(parameter.name, value=spec.cast(parameter.value))
    return parameter
