"""How fast the graph is, how much memory its processes take, and where the time goes.

    .venv/bin/python benchmarks/graph.py [--duration 12960] [--set KEY=VALUE ...] [--json]

Runs the scenario as four node processes and a recorder, then in one process, then once more in one
process with clocks on every callback."""

import json
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import closed_loop
import psutil
from clock import Clock
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from isogal.fields.scenario_map import map_for_scenario
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.bags import recorder as recorder_module
from isogal_ros.graph.plan import CLASSES, Plan
from isogal_ros.graph.running import run_in_process, run_processes
from isogal_ros.nodes import base as node_module
from isogal_ros.nodes.signals import interrupts
from isogal_ros.topics import Topic

Handler = Callable[..., None]


Figures = dict[str, float | dict[str, dict[str, float]] | list[dict[str, str | float]]]
"""Times, and figures of processes or parts."""
SAMPLE_EVERY = 0.25
"""s between looks at the processes."""


class Usage(threading.Thread):
    """Follows resident memory and processor time of this process's children."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.done = threading.Event()
        self.peak: dict[str, float] = defaultdict(float)
        self.seconds: dict[str, float] = defaultdict(float)

    def run(self) -> None:
        while not self.done.wait(SAMPLE_EVERY):
            for child in psutil.Process().children():
                try:
                    words = child.cmdline()
                    name = next(name for name, (module, _) in CLASSES.items() if module in words)
                    self.peak[name] = max(self.peak[name], child.memory_info().rss / 1e6)
                    times = child.cpu_times()
                    self.seconds[name] = times.user + times.system
                except (psutil.Error, StopIteration):
                    continue


def as_processes(scenario: Scenario, folder: Path) -> Figures:
    usage = Usage()
    usage.start()
    begun = time.monotonic()
    with interrupts() as interrupt:
        wall = run_processes(Plan(scenario, folder / "bag"), folder / "log", interrupt)
    total = time.monotonic() - begun
    usage.done.set()
    usage.join()
    return {
        "wall_s": wall,
        "with_start_and_end_s": total,
        "processes": {
            name: {"rss_mb": usage.peak[name], "cpu_s": usage.seconds[name]}
            for name in sorted(usage.peak)
        },
    }


def in_one_process(scenario: Scenario, folder: Path) -> dict[str, float]:
    with interrupts() as interrupt:
        wall = run_in_process(Plan(scenario, folder / "bag"), interrupt)
    return {"wall_s": wall, "rss_mb": psutil.Process().memory_info().rss / 1e6}


PUBLISH = "publish: serialise and send"


def watch_callbacks(clock: Clock) -> None:
    """Time every callback of the nodes and the recorder, and publishing: what is published inside
    a callback counts as publication only."""
    listen = node_module.GraphNode.listen
    subscribe = recorder_module.RecorderNode.create_subscription

    def timed_listen(
        node: node_module.GraphNode, topic: Topic, handler: Handler, raw: bool = False
    ) -> Subscription:
        return listen(node, topic, clock.timed(f"{node.get_name()}: {topic.name}", handler), raw)

    def timed_subscribe(
        node: Node, kind: type, name: str, callback: Handler, *rest: QoSProfile, **keys: bool
    ) -> Subscription:
        timed = clock.timed("isogal_recorder: write", callback)
        return subscribe(node, kind, name, timed, *rest, **keys)

    node_module.GraphNode.listen = timed_listen
    recorder_module.RecorderNode.create_subscription = timed_subscribe
    clock.watch(PUBLISH, Publisher, "publish")


def where_time_goes(scenario: Scenario, folder: Path) -> Figures:
    clock = Clock(time.perf_counter)
    watch_callbacks(clock)
    wall = in_one_process(scenario, folder)["wall_s"]
    rest = "executor: take, decode, dispatch (the rest)"
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
    runs = [
        ["four processes and recorder", processes["wall_s"], None],
        *(
            [f"  {name}", usage["cpu_s"], usage["rss_mb"]]
            for name, usage in processes["processes"].items()
        ),
        ["one process", one["wall_s"], one["rss_mb"]],
    ]
    print(
        f"Scenario of {simulated:.0f} s, {psutil.cpu_count()} processors, load before the start"
        f" {result['load']:.1f}; processes with start and end"
        f" {processes['with_start_and_end_s']:.1f} s.\n"
    )
    rows = (
        [name, f"{wall:.1f}", f"{simulated / wall:.0f}", "" if memory is None else f"{memory:.0f}"]
        for name, wall, memory in runs
    )
    head = ("run, or process", "s (of processes: CPU)", "x real time", "MB resident at most")
    print(closed_loop.markdown(head, rows))
    print(f"\nWhere the time goes in one process ({parts['wall_s']:.1f} s with the clocks on):\n")
    rows = ([row["part"], f"{row['seconds']:.2f}", f"{row['calls']}"] for row in parts["parts"])
    print(closed_loop.markdown(("part", "s", "calls"), rows))


def main() -> None:
    parser = closed_loop.parser(__doc__, "duration", "set", "json")
    options = parser.parse_args()
    changes = options.set + ([f"route.duration={options.duration}"] if options.duration else [])
    scenario = load_scenario(None, changes)
    trajectory = build_trajectory(scenario)
    map_for_scenario(scenario, trajectory)  # made once, so that no run makes it
    load = psutil.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        result = {
            "simulated_s": float(trajectory.time[-1]),
            "load": load,
            "processes": as_processes(scenario, place),
        }
        result["in_process"] = in_one_process(scenario, place)
        result["where_time_goes"] = where_time_goes(scenario, place)
    if options.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)


if __name__ == "__main__":
    main()
