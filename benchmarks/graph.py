"""How fast the graph is, how much memory its processes take, and where the time goes.

    .venv/bin/python benchmarks/graph.py [--duration 12960] [--set KEY=VALUE ...] [--limit]
        [--json]

Runs the scenario as four node processes and a recorder, then in one process, then once more in one
process with clocks on every callback. With --limit also bare nodes that only send the same
messages to and fro (`relay.py`), just after the graph whose limit they are, and the same run
without nodes: the graph takes as long as both and what its nodes do with the messages."""

import json
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import closed_loop
import psutil
import relay
from clock import Clock

from isogal.fields.scenario_map import map_for_scenario
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.domain import graph_domain
from isogal_ros.graph.plan import CLASSES, Plan
from isogal_ros.graph.running import Progress, run_in_process, run_processes
from isogal_ros.nodes.listening import Listening
from isogal_ros.nodes.signals import interrupts

Figures = dict[str, float | dict[str, dict[str, float]] | list[dict[str, str | float]]]
"""Times, and figures of processes or parts."""


class Usage:
    """Follows processes while the graph runs: as the graph's report, it is told the progress.

    Parameters
    ----------
    processes : callable
        Returns the processes by name.
    """

    def __init__(self, processes: Callable[[], dict[str, psutil.Process]]) -> None:
        self._processes = processes
        self.peak: dict[str, float] = defaultdict(float)
        """Resident memory at most, MB."""
        self._seen: list[tuple[float, dict[str, float]]] = []
        """Steps and processor time (s) at the first look and at the last."""

    def __call__(self, progress: Progress) -> None:
        self.look(progress.simulated)

    def look(self, steps: float) -> None:
        """Look at the processes after so many steps."""
        seconds = {}
        with suppress(psutil.Error):
            for name, process in self._processes().items():
                self.peak[name] = max(self.peak[name], process.memory_info().rss / 1e6)
                times = process.cpu_times()
                seconds[name] = times.user + times.system
            if not self._seen or seconds.keys() >= self._seen[0][1].keys():  # none has ended
                self._seen[1:] = [(steps, seconds)]

    @property
    def per_step(self) -> dict[str, float]:
        """Processor time of each process, ms a step."""
        if len(self._seen) < 2:
            raise SystemExit(
                "graph.py: the run was over before its processes were seen twice; give"
                " a longer --duration"
            )
        (first, before), (last, after) = self._seen
        return {
            name: 1e3 * (seconds - before[name]) / (last - first)
            for name, seconds in after.items()
        }


def nodes_running() -> dict[str, psutil.Process]:
    """Return the processes of the graph's nodes, below this one."""
    found = {child.name(): child for child in psutil.Process().children(recursive=True)}
    return {name: child for name, child in found.items() if name in CLASSES}


def as_processes(scenario: Scenario, folder: Path) -> Figures:
    usage = Usage(nodes_running)
    with interrupts() as interrupt:
        wall = run_processes(Plan(scenario, folder / "bag"), folder / "log", interrupt, usage)
    return {
        "wall_s": wall,
        "processes": {
            name: {"rss_mb": usage.peak[name], "ms_per_step": ms}
            for name, ms in sorted(usage.per_step.items())
        },
    }


def in_one_process(scenario: Scenario, folder: Path) -> Figures:
    usage = Usage(lambda: {ALL: psutil.Process()})
    with interrupts() as interrupt:
        wall = run_in_process(Plan(scenario, folder / "bag"), interrupt, usage)
    return {"wall_s": wall, "rss_mb": usage.peak[ALL], "ms_per_step": usage.per_step[ALL]}


ALL = "all nodes"


def limit_of(scenario: Scenario, bag: Path, *processes: Sequence[str]) -> Figures:
    """Run bare nodes for the steps of a bag: the names of those in each process, the simulator's
    last."""
    with graph_domain(scenario) as domain:
        started = [
            subprocess.Popen(
                [sys.executable, relay.__file__, str(bag), str(domain), *names],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for names in processes
        ]
        usage = Usage(
            lambda: {
                names[-1] if len(names) == 1 else ALL: psutil.Process(process.pid)
                for names, process in zip(processes, started, strict=True)
            }
        )
        said = started[-1].stdout
        said.readline()
        usage.look(0.0)
        steps, wall = (float(word) for word in said.readline().split())
        usage.look(steps)
        for process in started:
            process.terminate()
            process.communicate()
    return {"wall_s": wall, "ms_per_step": usage.per_step}


def arithmetic(scenario: Scenario) -> float:
    """Return the processor time, ms a step, of the same run without nodes: simulation,
    readings, filter, matching. What does not grow with the route is not counted."""
    whole = scenario.route.duration

    def seconds(duration: float) -> float:
        route = scenario.route.model_copy(update={"duration": duration})
        begun = time.process_time()
        simulate(scenario.model_copy(update={"route": route}), range(1))
        return time.process_time() - begun

    seconds(0.3 * whole)  # compiles, and makes the map
    short, long = seconds(0.2 * whole), seconds(whole)
    return 1e3 * (long - short) / (0.8 * whole * scenario.navigation_rate)


PUBLISH = "publish: serialise and hand on"


def watch_callbacks(clock: Clock) -> None:
    """Time what nodes of one process do with each message, decoding included, and publishing: what
    is published inside a callback counts as publication only."""
    join = Bus.join

    def timed_join(bus: Bus, listening: Listening) -> None:
        name = f"{listening.node.get_name()}: {listening.topic.name.lstrip('/')}"
        if name.startswith(RECORDER):
            name = f"{RECORDER}: write"
        listening.deliver = clock.timed(name, listening.deliver)
        join(bus, listening)

    Bus.join = timed_join
    clock.watch(PUBLISH, Bus, "send")


def where_time_goes(scenario: Scenario, folder: Path) -> Figures:
    clock = Clock(time.perf_counter)
    watch_callbacks(clock)
    wall = in_one_process(scenario, folder)["wall_s"]
    rest = "the rest: dispatch, timers, looks at progress"
    clock.seconds[rest] = wall - sum(clock.seconds.values())
    rows = sorted(clock.seconds.items(), key=lambda item: -item[1])
    return {
        "wall_s": wall,
        "parts": [
            {"part": name, "calls": len(clock.calls[name]), "seconds": seconds}
            for name, seconds in rows
        ],
    }


def show(result: dict[str, float | Figures]) -> None:
    simulated = result["simulated_s"]
    processes, one, parts = result["processes"], result["in_process"], result["where_time_goes"]
    limits = result.get("limit") or {}
    bare = limits.get("processes", {}).get("ms_per_step", {})
    runs: list[tuple[str, *tuple[float | None, ...]]] = [
        ("four processes and recorder", processes["wall_s"], None, None, None)
    ]
    for name, used in processes["processes"].items():
        of_bare = bare.get(RELAYS.get(name, name))
        runs.append((f"  {name}", None, used["ms_per_step"], of_bare, used["rss_mb"]))
    of_bare = limits.get("in_process", {}).get("ms_per_step", {}).get(ALL)
    runs.append(("one process", one["wall_s"], one["ms_per_step"], of_bare, one["rss_mb"]))
    print(
        f"Scenario of {simulated:.0f} s, {psutil.cpu_count()} processors, load before the start"
        f" {result['load']:.1f}.\n"
    )
    digits = (1, 2, 2, 0)
    rows = (
        [name, *("" if x is None else f"{x:.{n}f}" for x, n in zip(row, digits, strict=True))]
        for name, *row in runs
    )
    head = ("run, or process", "s", "CPU, ms a step", "of bare nodes", "MB resident at most")
    print(closed_loop.markdown(head, rows))
    if limits:
        print("\nSteps per second as a share of what bare nodes make:", end="")
        shares = (limits[k]["wall_s"] / result[k]["wall_s"] for k in ("processes", "in_process"))
        print(" {:.2f} in four processes, {:.2f} in one.".format(*shares))
        print(f"Without nodes a step takes {limits['arithmetic_ms_per_step']:.2f} ms of CPU.")
    print(f"\nWhere the time goes in one process ({parts['wall_s']:.1f} s with the clocks on):\n")
    rows = ([row["part"], f"{row['seconds']:.2f}", f"{row['calls']}"] for row in parts["parts"])
    print(closed_loop.markdown(("part", "s", "calls"), rows))


RELAYS = {RECORDER: relay.RECORDER}
"""Names of processes that are others among the bare nodes."""


def main() -> None:
    parser = closed_loop.parser(__doc__, "duration", "set", "json")
    parser.add_argument("--limit", action="store_true", help="run bare nodes as well")
    options = parser.parse_args()
    changes = options.set + ([f"route.duration={options.duration}"] if options.duration else [])
    scenario = load_scenario(None, changes)
    trajectory = build_trajectory(scenario)
    map_for_scenario(scenario, trajectory)  # made once, so that no run makes it
    load = psutil.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        limits: dict[str, float | Figures] = {}
        result = {
            "simulated_s": float(trajectory.time[-1]),
            "load": load,
            "limit": limits,
            "processes": as_processes(scenario, place),
        }
        if options.limit:
            each = [[name] for name in relay.NODES]
            limits["processes"] = limit_of(scenario, place / "bag", *each)
        result["in_process"] = in_one_process(scenario, place)
        if options.limit:
            limits["in_process"] = limit_of(scenario, place / "bag", relay.NODES)
            limits["arithmetic_ms_per_step"] = arithmetic(scenario)
        result["where_time_goes"] = where_time_goes(scenario, place)
    if options.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)


if __name__ == "__main__":
    main()
