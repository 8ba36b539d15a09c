"""``isogal run``, ``replay``, ``faults`` and ``smooth``: the graph of nodes, recorded, and
recordings played to fresh nodes."""

import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json, ScenarioChoice, flag, number, text, written_folder
from isogal.errors import InputError


@dataclass(frozen=True)
class TopicChoice:
    """How the recordings of other software are taken for the graph's."""

    remap: Annotated[
        list[str] | None,
        text(
            "FROM:=TO",
            "A recorded topic that stands for one of the graph's, e.g."
            " /sbg/imu:=imu/data_raw; repeatable.",
        ),
    ] = None
    driver: Annotated[
        list[str] | None,
        text(
            "TOPIC.KEY=VALUE",
            "How messages of a sensor come: frame, rotation, translation, from_tf or unit, e.g."
            " gravimeter/data_raw.unit=mGal; repeatable.",
        ),
    ] = None


@dataclass(frozen=True)
class ReplayChoice(ScenarioChoice, TopicChoice):
    """What is not as it was recorded."""

    parameter: Annotated[
        list[str] | None,
        text(
            "NAME=VALUE", "Own parameter of ukf_fusion_node, e.g. imu_frame=imu_link; repeatable."
        ),
    ] = None


@dataclass(frozen=True)
class GraphChoice:
    """How the graph is run, and watched meanwhile."""

    in_process: Annotated[
        bool, flag("--in-process", "All nodes in this process instead of one process each.")
    ] = False
    rate: Annotated[
        float, number("Simulated seconds per second; 0 = as fast as possible.", least=0.0)
    ] = 0.0
    respawn: Annotated[
        bool,
        flag("--respawn", "Start a node that was killed again, from its checkpoint in --out."),
    ] = False
    live: Annotated[
        bool, flag("--live", "Serve the page of `isogal view` to this machine meanwhile.")
    ] = False
    port: Annotated[
        int, number("Of --live; default: any that is free.", "N", least=0, most=65535)
    ] = 0
    dashboard: Annotated[
        bool, flag("--dashboard", "Show errors, fixes and messages in the terminal.")
    ] = False
    domain: Annotated[
        int | None,
        number(
            "ROS domain that must be used; the command ends with status 2 where others publish"
            " its topics there. Default: ROS_DOMAIN_ID if none do, else one that is free.",
            "N",
            least=0,
            most=232,
        ),
    ] = None

    def __post_init__(self) -> None:
        if self.port and not self.live:
            raise InputError(f"--port {self.port}: goes with --live")
        if self.respawn and self.in_process:
            raise InputError("--respawn: nodes in one process cannot be started again one by one")


def bag_of(source: Path) -> Path:
    """Return the recording of a run, by its folder, or what is a recording itself; raises
    InputError where there is nothing."""
    if not source.exists():
        raise InputError(f"{source}: no such recording or folder")
    return source / "bag" if (source / "bag").is_dir() else source


@with_groups
def run(
    chosen: ScenarioChoice,
    how: GraphChoice,
    bag: Annotated[
        Path | None, written_folder("Folder of the recording; default: bag in --out.")
    ] = None,
    out: Annotated[Path, written_folder("Folder of summary, report and figures.")] = Path(
        "out/run"
    ),
    json: Json = False,
) -> None:
    """Simulate a scenario with the navigator in the loop: four nodes and a recorder over DDS.

    Writes a bag, summary.json, report.html and the figures. Ctrl-C stops all nodes and keeps the
    bag."""
    require_ros()
    from isogal_ros.graph import forkserver

    settings = chosen.load()
    if not how.in_process:
        forkserver.start()  # which imports what the nodes need while this process does
    from isogal_ros.graph.commands import run_command

    raise typer.Exit(run_command(settings, out, bag, how=how, json=json))


@with_groups
def replay(
    chosen: ReplayChoice,
    bag: Annotated[
        Path, typer.Argument(metavar="BAG", help="Folder of a recording or run, or an MCAP file.")
    ],
    out: Annotated[
        Path | None, written_folder("Folder for summary, report and figures of the replay.")
    ] = None,
    tolerance: Annotated[
        float | None,
        number(
            "Exit with status 1 where fixes differ by more than this, m; default: 1, or"
            " anything with --scenario, --set, --parameter, --remap or --driver.",
            "M",
            least=0.0,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Feed a recording's sensor messages to a fresh matcher and filter; say how far the fixes
    differ from the recorded ones.

    Exits with 1 where they differ by too much, no message of a sensor was used, or there was no
    fix. The scenario is the recording's own; --scenario names another, --set changes keys."""
    require_ros()
    from isogal_ros.graph.commands import replay_command

    raise typer.Exit(replay_command(bag, out, chosen, tolerance=tolerance, json=json))


@with_groups
def faults(
    chosen: ScenarioChoice,
    out: Annotated[
        Path, written_folder("Folder of outcomes and table; what is there is not run again.")
    ],
    quick: Annotated[
        bool, flag("--quick", "A few faults over ten minutes instead of all.")
    ] = False,
    trials: Annotated[int, number("Trials of each fault.", "N", least=0)] = 1,
    json: Json = False,
) -> None:
    """Run the nodes with faulty sensors, messages and nodes: what is reported, what harm is done.

    Exits with 1 where a trial died or hung, something not finite was published, an exception was
    not expected, a fault that matters was not reported within two batches, or the error stayed
    more than 1.3 times as large as without."""
    require_ros()
    from isogal_ros.graph.commands import faults_command

    status = faults_command(chosen.load(), out, trials=trials, quick=quick, json=json)
    raise typer.Exit(status)


@with_groups
def smooth(
    chosen: ReplayChoice,
    source: Annotated[
        Path,
        typer.Argument(metavar="BAG|RUN", help="Folder of a recording or run, or an MCAP file."),
    ],
    out: Annotated[
        Path, written_folder("Folder for smoothed.csv, .geojson, .gpx and a bag.")
    ] = Path("out/smooth"),
    interval: Annotated[
        float,
        number(
            "Seconds between the rows of the files, at least; the bag has every state.",
            "S",
            least=0.0,
        ),
    ] = 1.0,
    json: Json = False,
) -> None:
    """Say of each moment of a recorded voyage where the vehicle was, by all data of the voyage:
    those that came later, too.

    The sensor messages are played to fresh nodes as by `isogal replay`. Where the truth was
    recorded, the errors are printed. The scenario is the recording's own; --scenario names
    another, --set changes keys."""
    bag = bag_of(source)
    if (source / "results.json").is_file() and not any(bag.glob("*.mcap*")):
        raise InputError(f"{source}: has no recording; isogal montecarlo --smooth smooths a study")
    require_ros("smooth")
    from isogal_ros.graph.commands import smooth_command

    raise typer.Exit(smooth_command(bag, out, chosen, interval=interval, json=json))


def require_ros(what: str = "run, replay and faults") -> None:
    """Raise InputError where the nodes cannot run, or their messages cannot be read."""
    for module, name in (
        ("rclpy", "ROS 2 (rclpy)"),
        ("isogal_ros", "the package isogal_ros"),
        ("mcap", "the Python package mcap"),
    ):
        if find_spec(module) is None:
            raise InputError(
                f"{name} is not installed for {sys.executable}, which {what} need; the other"
                " commands do not (see README.md)"
            )
