"""``isogal run`` and ``isogal replay``: the graph of nodes, recorded, and recordings played to
fresh nodes."""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from isogal.errors import InputError

ScenarioOption = Annotated[
    Path | None,
    typer.Option(
        "--scenario", metavar="FILE", help="Scenario file (YAML); default: all defaults."
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key, e.g. matcher.batch_length=15; repeatable.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


def run(
    scenario: ScenarioOption = None,
    set_: SetOption = None,
    in_process: Annotated[
        bool,
        typer.Option(
            "--in-process", help="All nodes in this process instead of one process each."
        ),
    ] = False,
    bag: Annotated[
        Path | None,
        typer.Option(
            "--bag", metavar="DIR", help="Folder of the recording; default: bag in --out."
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of summary, report and figures.")
    ] = Path("out/run"),
    rate: Annotated[
        float,
        typer.Option(
            "--rate", min=0.0, help="Simulated seconds per second; 0 = as fast as possible."
        ),
    ] = 0.0,
    json: JsonOption = False,
) -> None:
    """Simulate a scenario with the navigator in the loop: four nodes and a recorder over DDS.

    Writes a bag, summary.json, report.html and the figures. Ctrl-C stops all nodes and keeps the
    bag."""
    _require_ros()
    from isogal.scenario import load_scenario
    from isogal_ros.graph.session import run_session

    settings = load_scenario(scenario, set_ or ())
    raise typer.Exit(run_session(settings, out, bag, in_process=in_process, rate=rate, json=json))


def replay(
    bag: Annotated[
        Path, typer.Argument(metavar="BAG", help="Folder of a recording, or its MCAP file.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="Folder for summary, report and figures of the replay."
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Feed a recording's sensor messages to a fresh matcher and filter; say how far the fixes
    differ from the recorded ones."""
    _require_ros()
    from isogal_ros.graph.session import replay_session

    raise typer.Exit(replay_session(bag, out, json=json))


def _require_ros() -> None:
    """Raise InputError where the nodes cannot run."""
    for module, what in (
        ("rclpy", "ROS 2 (rclpy)"),
        ("isogal_ros", "the package isogal_ros"),
        ("mcap", "the Python package mcap"),
    ):
        if find_spec(module) is None:
            raise InputError(
                f"{what} is not installed for {sys.executable}: run and replay need it; the other"
                " commands do not (see README.md)"
            )


__all__: list[Any] = ["replay", "run"]
