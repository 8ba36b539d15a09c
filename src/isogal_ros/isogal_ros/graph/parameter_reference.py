"""The reference of all parameters, made from their descriptors.

``python -m isogal_ros.graph.parameter_reference > docs/parameters.md`` writes it anew after a
change of the scenario model or of a node's own parameters."""

from collections.abc import Iterable, Iterator

import yaml

from isogal.cli.errors import clean_errors
from isogal.scenario import Scenario
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.plan import node_class
from isogal_ros.mavlink.node import MAVLINK
from isogal_ros.parameters.bringup_file import comment
from isogal_ros.parameters.from_model import ParameterSpec, parameter_specs
from isogal_ros.topics import NODES

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


def lines() -> Iterator[str]:
    """Yield the lines of the page."""
    yield HEAD
    names = (*NODES, RECORDER, MAVLINK)
    models = {name: node_class(name).settings_model for name in names}
    shared = set.intersection(*(set(model.model_fields) for model in models.values()))
    yield "## Of every node\n"
    yield from table(spec for spec in parameter_specs(models[RECORDER]) if top_of(spec) in shared)
    for name in names:
        own = [spec for spec in parameter_specs(models[name]) if top_of(spec) not in shared]
        yield f"\n## Of `{name}`\n"
        if own:
            yield from table(own)
            yield ""
        yield f"- Sections of the scenario: {', '.join(sorted(node_class(name).sections))}."
        mutable = ", ".join(f"`{key}`" for key in node_class(name).mutable)
        yield f"- May change while it runs: {mutable or 'none'}."
    yield "\n## Keys of a scenario\n"
    yield from table(parameter_specs(Scenario))


def top_of(spec: ParameterSpec) -> str:
    """Return the field of the model that a parameter belongs to."""
    return spec.name.partition(".")[0]


def table(specs: Iterable[ParameterSpec]) -> Iterator[str]:
    """Yield the rows of a table of parameters."""
    yield "| parameter | type | default | |"
    yield "|---|---|---|---|"
    for spec in specs:
        descriptor = spec.descriptor
        default = yaml.safe_dump(spec.default, default_flow_style=True, width=1000)
        default = default.splitlines()[0].replace("|", "\\|")
        kind = "any" if descriptor.dynamic_typing else TYPES.get(descriptor.type, "any")
        yield f"| `{spec.name}` | {kind} | `{default}` | {escaped(comment(spec))} |"


def escaped(about: str) -> str:
    """Return a text for a cell."""
    return about.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def text() -> str:
    """Return the whole page."""
    return "\n".join(lines()) + "\n"


@clean_errors
def main() -> None:
    """Print the whole page."""
    print(text(), end="", flush=True)


if __name__ == "__main__":
    main()
