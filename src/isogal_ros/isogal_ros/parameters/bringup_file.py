"""The parameter file of the bringup package: every scenario key with its default, unit and limits.

``python -m isogal_ros.parameters.bringup_file > src/isogal_bringup/params/isogal.yaml`` writes it
anew after a change of the scenario model."""

import textwrap
from collections.abc import Iterator

import yaml

from isogal.cli.errors import clean_errors
from isogal.scenario import Scenario
from isogal_ros.parameters.from_model import ParameterSpec, limits, parameter_specs

WIDTH = 99
"""Columns of the file."""
HEAD = """\
# Parameters of all nodes of the graph: the keys of a scenario (the same as in a scenario file of
# `isogal run`), with their defaults. Made by `python -m isogal_ros.parameters.bringup_file`.
# A node's own parameters (`ros2 param list`) go under its name, for example
#   /**/ins_sim_node: {ros__parameters: {rate: 0.0}}
/**:
  ros__parameters:
"""


def lines() -> Iterator[str]:
    """Yield the lines of the file below its head."""
    section = ""
    for spec in parameter_specs(Scenario):
        parent, _, key = spec.name.rpartition(".")
        if parent != section:
            section = parent
            yield from [f"    {parent}:"] if parent else []
        indent = " " * (6 if parent else 4)
        value = yaml.safe_dump(spec.default, default_flow_style=True).splitlines()[0]
        line = f"{indent}{key}: {value}  # {comment(spec)}"
        if len(line) <= WIDTH:
            yield line
        else:
            yield from textwrap.wrap(
                comment(spec), WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# "
            )
            yield f"{indent}{key}: {value}"


def comment(spec: ParameterSpec) -> str:
    """Return what a parameter is, its limits and what stands for null."""
    ends, constraints = limits(spec.descriptor), spec.descriptor.additional_constraints
    parts = [spec.descriptor.description or "see docs", ends]
    if constraints not in ends:
        parts.append(constraints)
    return "; ".join(part for part in parts if part)


def text() -> str:
    """Return the whole file."""
    return HEAD + "\n".join(lines()) + "\n"


@clean_errors
def main() -> None:
    """Print the whole file."""
    print(text(), end="", flush=True)


if __name__ == "__main__":
    main()
