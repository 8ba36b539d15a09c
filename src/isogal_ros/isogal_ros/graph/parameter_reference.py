"""All parameters, made from their descriptors: the page of the documentation, and the parameter
file of the bringup package with every scenario key, its default, unit and limits.

After a change of the scenario model or of a node's own parameters, these write them anew::

    python -m isogal_ros.graph.parameter_reference > docs/parameters.md
    python -m isogal_ros.graph.parameter_reference yaml > src/isogal_bringup/params/isogal.yaml"""

import sys
import textwrap
from collections.abc import Iterable, Iterator

import yaml
from pydantic import JsonValue

from isogal.cli.errors import clean_errors
from isogal.scenario import Scenario
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.plan import node_class
from isogal_ros.mavlink.node import MAVLINK
from isogal_ros.parameters.from_model import ParameterSpec, limits, parameter_specs
from isogal_ros.topics import NODES

WIDTH = 99
"""Columns of the file."""
FILE_HEAD = """\
# Parameters of all nodes of the graph: the keys of a scenario (the same as in a scenario file of
# `isogal run`), with their defaults. Made by
# `python -m isogal_ros.graph.parameter_reference yaml`.
# A node's own parameters (`ros2 param list`) go under its name, for example
#   /**/ins_sim_node: {ros__parameters: {rate: 0.0}}
/**:
  ros__parameters:"""
HEAD = """\
# Parameters

Made from the descriptors by `python -m isogal_ros.graph.parameter_reference`; the same is
said by `ros2 param describe`. The keys of a scenario file are those of the last part, and
[nodes.md](nodes.md#parameters) says how the nodes take them.
"""
TYPES = {
    1: "bool", 2: "integer", 3: "double", 4: "text", 6: "bools", 7: "integers", 8: "doubles",
    9: "texts",
}  # fmt: skip
"""By the numbers of rcl_interfaces/msg/ParameterType."""


def file_lines() -> Iterator[str]:
    """Yield the lines of the parameter file."""
    yield FILE_HEAD
    section = ""
    for spec in parameter_specs(Scenario):
        parent, _, key = spec.name.rpartition(".")
        if parent not in ("", section):
            yield f"    {parent}:"
        section, indent = parent, " " * (6 if parent else 4)
        value, about = f"{indent}{key}: {yaml_of(spec.default)}", f"{indent}# "
        if len(f"{value}  # {comment(spec)}") <= WIDTH:
            yield f"{value}  # {comment(spec)}"
        else:
            yield from textwrap.wrap(
                comment(spec), WIDTH, initial_indent=about, subsequent_indent=about
            )
            yield value


def lines() -> Iterator[str]:
    """Yield the lines of the page."""
    yield HEAD
    kinds = {name: node_class(name) for name in (*NODES, RECORDER, MAVLINK)}
    models = {name: kind.settings_model for name, kind in kinds.items()}
    shared = set.intersection(*(set(model.model_fields) for model in models.values()))

    def specs(name: str, is_shared: bool) -> Iterator[ParameterSpec]:
        """Yield the own parameters of a node that all have, or that it alone has."""
        for spec in parameter_specs(models[name]):
            if (spec.name.partition(".")[0] in shared) == is_shared:
                yield spec

    yield "## Of every node\n"
    yield from table(specs(RECORDER, is_shared=True))
    for name, kind in kinds.items():
        yield f"\n## Of `{name}`\n"
        if own := [*specs(name, is_shared=False)]:
            yield from [*table(own), ""]
        yield f"- Sections of the scenario: {', '.join(sorted(kind.sections))}."
        mutable = ", ".join(f"`{key}`" for key in kind.mutable)
        yield f"- May change while it runs: {mutable or 'none'}."
    yield "\n## Keys of a scenario\n"
    yield from table(parameter_specs(Scenario))


def yaml_of(value: JsonValue) -> str:
    """Return a default in one line."""
    return yaml.safe_dump(value, default_flow_style=True, width=1000).splitlines()[0]


def comment(spec: ParameterSpec) -> str:
    """Return what a parameter is, its limits and what stands for null."""
    ends, constraints = limits(spec.descriptor), spec.descriptor.additional_constraints
    parts = [spec.descriptor.description or "see docs", ends]
    if constraints not in ends:
        parts.append(constraints)
    return "; ".join(part for part in parts if part)


def table(specs: Iterable[ParameterSpec]) -> Iterator[str]:
    """Yield the rows of a table of parameters."""
    yield "| parameter | type | default | |"
    yield "|---|---|---|---|"
    for spec in specs:
        descriptor = spec.descriptor
        default = yaml_of(spec.default).replace("|", "\\|")
        kind = "any" if descriptor.dynamic_typing else TYPES.get(descriptor.type, "any")
        about = comment(spec).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")
        yield f"| `{spec.name}` | {kind} | `{default}` | {about} |"


def text(of_file: bool = False) -> str:
    """Return the whole page, or the whole file."""
    return "\n".join(file_lines() if of_file else lines()) + "\n"


@clean_errors
def main() -> None:
    """Print the page, or the file where the command line says ``yaml``."""
    print(text("yaml" in sys.argv[1:]), end="", flush=True)


if __name__ == "__main__":
    main()
