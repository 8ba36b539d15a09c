"""Own parameters of the filter's node that a replay is given beside the scenario."""

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import ParameterType

from isogal.errors import InputError
from isogal.yaml_text import parse_yaml
from isogal_ros import topics
from isogal_ros.graph.plan import node_class
from isogal_ros.nodes.base import NodeSettings
from isogal_ros.parameters.from_model import parameter_specs
from isogal_ros.parameters.values import settings_from


def filter_parameters(texts: Sequence[str]) -> dict[str, Any]:
    """Return parameters by name from ``NAME=VALUE``, values in YAML.

    Raises
    ------
    InputError
        The node has no such parameter, or none of that value; the line names it.
    """
    model = node_class(topics.UKF_FUSION).settings_model
    of_all = NodeSettings.model_fields
    specs = {spec.name: spec for spec in parameter_specs(model) if spec.name not in of_all}
    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--parameter: must be NAME=VALUE, not {text!r}")
        spec = specs.get(name)
        if spec is None:
            near = get_close_matches(name, specs, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise InputError(f"--parameter {name}: no parameter of {topics.UKF_FUSION}{hint}")
        is_text = spec.descriptor.type == ParameterType.PARAMETER_STRING
        content = value if is_text else parse_yaml(value, f"--parameter {name}")
        found[name] = spec.cast(content)
    settings_from(model, found, "--parameter")
    return found
