"""A long run with faults: does a node's memory grow, do its files stay open?

    .venv/bin/python benchmarks/soak.py [--hours 24] [--faults 4] [--kill] [--set KEY=VALUE ...]

Runs the graph as processes to and fro over an area for many simulated hours, and stops or slows a
node that is drawn, `--faults` times an hour, or with `--kill` also kills it, so that it is started
again from its checkpoint. Says for each process (of one that was killed, the last) how much more
memory it has in the last tenth of the time than after the first fifth, and how many more open
files."""

import json
import math
import os
import shutil
import signal
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from multiprocessing import active_children
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import closed_loop
import numpy as np
import psutil

from isogal.scenario import Scenario, load_scenario
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.faults.catalogue import Fault
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.running import Progress, run_processes
from isogal_ros.nodes.signals import interrupts

LIMIT_MB, LIMIT_FILES = 5.0, 0
EVERY = 1.0
"""s of wall time between looks at the processes."""
ENDS = ([-37.8, 145.0], [-37.2, 146.2])
"""Between which the vehicle goes to and fro, deg: 124 km."""
LEG = 5600.0
"""s that it takes at `SPEED`."""
SPEED = 22.0
TURN = 0.1
"""s that a slow node is stopped, and then goes."""
EVERY_NODE = (RECORDER, *topics.NODES)
FAULTS = (
    *(Fault(f"{name} stopped for 3 s", (name,), "stopped", 3.0) for name in EVERY_NODE),
    *(Fault(f"{name} at half speed", (name,), "slow", 5.0) for name in EVERY_NODE),
)
KILLS = tuple(Fault(f"{name} killed", (name,), "killed", 1.0) for name in EVERY_NODE)


class Signals:
    """Does a fault to the processes of a run from a simulated time (s) on; how long it lasts is
    wall time."""

    def __init__(self, fault: Fault, begin: float) -> None:
        self._fault, self._begin = fault, begin
        self._since, self._acts = math.inf, False
        self.over = False
        """Whether the fault has been done."""

    def __call__(self, processes: Mapping[str, BaseProcess], simulated: float) -> None:
        """Do what is due when the run is at a simulated time (s)."""
        if self._since == math.inf and simulated >= self._begin:
            self._since = time.monotonic()
        elapsed = time.monotonic() - self._since
        self.over = elapsed >= self._fault.lasts
        if self._acts == self._fault.is_on(elapsed, TURN):
            return
        self._acts = not self._acts
        stop = signal.SIGKILL if self._fault.effect == "killed" else signal.SIGSTOP
        for name in self._fault.targets:
            if name in processes:
                os.kill(int(processes[name].pid), stop if self._acts else signal.SIGCONT)


class Soak:
    """Looks at the processes of the nodes, and does faults to them, at each report of
    `run_processes`."""

    def __init__(self, scenario: Scenario, per_hour: float, faults: Sequence[Fault]) -> None:
        duration = scenario.route.duration or 0.0
        rng = generator(scenario.seed, 0, "soak")
        times = np.sort(rng.uniform(600.0, 0.98 * duration, int(per_hour * duration / 3600.0)))
        self._faults = [Signals(faults[int(rng.integers(len(faults)))], float(t)) for t in times]
        self._looked = 0.0
        self.seen: dict[str, list[tuple[float, float, int]]] = defaultdict(list)
        """Simulated time, MB, open files by node."""

    def __call__(self, progress: Progress) -> None:
        """Do what is due."""
        simulated, children = progress.simulated, {one.name: one for one in active_children()}
        processes = {name: children[name] for name in EVERY_NODE if name in children}
        while self._faults and self._faults[0].over:
            del self._faults[0]
        if self._faults:
            self._faults[0](processes, simulated)
        if time.monotonic() - self._looked < EVERY:
            return
        self._looked = time.monotonic()
        for name, process in processes.items():
            try:
                one = psutil.Process(process.pid)
                memory = one.memory_full_info().uss / 1e6
                self.seen[name].append((simulated, memory, one.num_fds()))
            except psutil.Error:
                continue

    def growth(self) -> list[dict[str, Any]]:
        """Return what has grown."""
        rows = []
        for name, looks in self.seen.items():
            at, memory, files = np.array(looks).T
            early = (at > 0.2 * at[-1]) & (at < 0.3 * at[-1])
            late = at > 0.9 * at[-1]
            rows.append(
                {
                    "node": name,
                    "memory_mb": float(np.median(memory[late])),
                    "grown_mb": float(np.median(memory[late]) - np.median(memory[early])),
                    "files": int(np.median(files[late])),
                    "grown_files": int(np.median(files[late]) - np.median(files[early])),
                }
            )
        return rows


def main() -> None:
    parser = closed_loop.parser(__doc__, "set")
    parser.add_argument("--hours", type=float, default=24.0, help="to simulate")
    parser.add_argument("--faults", type=float, default=4.0, help="per simulated hour")
    parser.add_argument("--kill", action="store_true", help="nodes are killed as well")
    options = parser.parse_args()
    duration = options.hours * 3600.0
    legs = int(duration / LEG) + 3
    points = [[*ENDS[k % 2], SPEED] for k in range(legs)]
    scenario = load_scenario(
        None, [f"route.waypoints={points}", f"route.duration={duration}", *options.set]
    )
    folder = Path(tempfile.mkdtemp())
    try:
        with interrupts() as interrupt:
            soak = Soak(scenario, options.faults, FAULTS + KILLS if options.kill else FAULTS)
            checkpoint = folder / "checkpoint" if options.kill else None
            if checkpoint is not None:
                checkpoint.mkdir()
            plan = Plan(scenario, folder / "bag", checkpoint=checkpoint)
            run_processes(plan, folder / "log", interrupt, soak)
    finally:
        shutil.rmtree(folder)
    rows = soak.growth()
    print(json.dumps(rows, indent=2))
    failed = [
        row["node"]
        for row in rows
        if row["grown_mb"] > LIMIT_MB or row["grown_files"] > LIMIT_FILES
    ]
    print(f"failed: {', '.join(failed) or 'none'}")
    raise SystemExit(bool(failed))


if __name__ == "__main__":
    main()
