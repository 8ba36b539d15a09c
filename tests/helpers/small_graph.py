"""The smallest graph of processes: a simulator that waits for nobody, and a recorder."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil

from isogal.errors import InputError
from isogal.scenario import load_scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.plan import CLASSES, Plan
from isogal_ros.graph.running import run_processes
from isogal_ros.nodes.signals import Interrupt

ENOUGH = 100
"""Messages that a test of a recording needs."""


class SmallPlan(Plan):
    """Half an hour, fifty times as fast as real time."""

    @property
    def names(self) -> tuple[str, ...]:
        """The recorder first, so that it hears everything."""
        return RECORDER, topics.INS_SIM

    def own(self, name: str) -> dict[str, Any]:
        """The node's own parameters; nobody else is expected to listen."""
        return super().own(name) | {"peers": [topics.INS_SIM]}


def small_plan(bag: Path) -> SmallPlan:
    """A plan with a bag."""
    scenario = load_scenario(None, ["route.duration=1800.0", "gravity.field=normal"])
    quick = {"closing_time": 2.0, "replace": True}
    return SmallPlan(scenario, bag, rate=50.0, lock_step=False, of_recorder=quick)


def has_recorded(bag: Path) -> bool:
    """Whether more than `ENOUGH` messages have been written out."""
    try:
        return sum(1 for _ in BagReader(bag).messages()) > ENOUGH
    except InputError:  # not begun yet
        return False


def nodes_of(pid: int) -> dict[str, psutil.Process]:
    """The node processes that a process has started, by name."""
    found = {}
    for child in psutil.Process(pid).children(recursive=True):
        with suppress(psutil.Error):  # it has just ended
            found[child.name()] = child
    return {name: child for name, child in found.items() if name in CLASSES}


def start(folder: Path) -> subprocess.Popen:
    """Run the graph in a process of its own, with its bag in the folder."""
    return subprocess.Popen(
        [sys.executable, "-m", __name__, str(folder)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )


if __name__ == "__main__":
    out = Path(sys.argv[1])
    run_processes(small_plan(out / "bag"), out / "log", Interrupt())
