"""Parameters declared on a node, and changed while it runs."""

from collections.abc import Callable, Collection, Mapping, Sequence

from pydantic import JsonValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from isogal.errors import InputError, nearest
from isogal_ros.parameters.from_model import ParameterSpec, yaml_line
from isogal_ros.parameters.values import Values, nested

OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare(
    node: Node,
    specs: Sequence[ParameterSpec],
    known: Collection[str],
    accept: Callable[[Values], None],
    change: Callable[[Values], None],
) -> None:
    """Declare parameters with the overrides of the command line and parameter files.

    The node must have been made with ``automatically_declare_parameters_from_overrides``: that is
    the public way to see overrides that nobody declares, which rclpy would ignore in silence.

    Parameters
    ----------
    known : collection of str
        Names that are no parameter of this node but may stand in a file that several nodes share.
    accept : callable
        Called with all values by name, as the model wants them, before they are declared.
    change : callable
        Called with those that are to change; an InputError refuses the change and is its reason.

    Raises
    ------
    InputError
        An override is unknown, or no value of the model, or `accept` refuses it.
    """
    overrides = {
        name: parameter.value
        for name, parameter in node.get_parameters_by_prefix("").items()
        if not name.startswith(OF_RCLPY)
    }
    for name in overrides:
        node.undeclare_parameter(name)
    by_name = {spec.name: spec for spec in specs}
    try:
        values = known_values(overrides, specs, known)
        found = fields_of(values, specs)
    except InputError as error:
        raise InputError(f"{node.get_name()}: {error}") from None
    accept(found)
    for name, spec in by_name.items():
        node.declare_parameter(name, values[name], spec.descriptor, ignore_override=True)

    def recast(parameters: list[Parameter]) -> list[Parameter]:
        own = [item for item in parameters if item.name in by_name]
        cast = [Parameter(item.name, value=by_name[item.name].cast(item.value)) for item in own]
        return cast + [item for item in parameters if item.name not in by_name]

    def take(parameters: list[Parameter]) -> SetParametersResult:
        own = [item for item in parameters if item.name in by_name]
        try:
            change({item.name: by_name[item.name].to_field(item.value) for item in own})
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_pre_set_parameters_callback(recast)
    node.add_on_set_parameters_callback(take)


def known_values(
    overrides: Mapping[str, JsonValue], specs: Sequence[ParameterSpec], known: Collection[str] = ()
) -> Values:
    """Return the values of parameters by name, by overrides or else their defaults; raises
    InputError for an override that neither is of a parameter nor `known`, see `declare`.

    Those inside a parameter that holds YAML (``truth.imu.grade``, as a parameter file with nested
    keys has it) are put together as its text."""
    names = {spec.name for spec in specs}
    allowed = names | set(known)
    kept: Values = {}
    parts: dict[str, Values] = {}
    for name, value in overrides.items():
        outer = next((key for key in allowed if name.startswith(f"{key}.")), None)
        if outer is not None and outer not in overrides:
            parts.setdefault(outer, {})[name.removeprefix(f"{outer}.")] = value
        elif name in allowed:
            kept[name] = value
        else:
            hint = nearest(name, allowed, 0.5) or f"; allowed: {', '.join(sorted(names))}"
            others = " (another node's own stand under that node's name in a file, not under /**)"
            raise InputError(f"unknown parameter '{name}'{hint}{others}")
    kept |= {outer: yaml_line(nested(part)) for outer, part in parts.items()}
    return {spec.name: spec.cast(kept.get(spec.name, spec.default)) for spec in specs}


def fields_of(values: Values, specs: Sequence[ParameterSpec]) -> Values:
    """Return the model's values for those of all parameters; raises InputError where there is
    none."""
    return {spec.name: spec.to_field(values[spec.name]) for spec in specs}
