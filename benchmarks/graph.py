"""How fast the graph is, how much memory its processes take, and where the time goes.

    .venv/bin/python benchmarks/graph.py [--duration 12960] [--set KEY=VALUE ...] [--json]

Runs the scenario as four node processes and a recorder, then in one process, then once more in one
process with clocks on every callback."""

import argparse
import json
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import psutil
from rclpy.publisher import Publisher

from isogal.scenario import Scenario, load_scenario
from isogal_ros.bags import recorder as recorder_module
from isogal_ros.graph.plan import CLASSES, Plan
from isogal_ros.graph.running import run_in_process, run_processes
from isogal_ros.nodes import base as node_module
from isogal_ros.nodes.signals import interrupts

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


def as_processes(scenario: Scenario, folder: Path) -> dict[str, Any]:
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


def in_one_process(scenario: Scenario, folder: Path) -> dict[str, Any]:
    with interrupts() as interrupt:
        wall = run_in_process(Plan(scenario, folder / "bag"), interrupt)
    return {"wall_s": wall, "rss_mb": psutil.Process().memory_info().rss / 1e6}


class Clocks:
    """Adds up the time in callbacks and in publishing; a publication inside a callback counts as
    publication only."""

    def __init__(self) -> None:
        self.calls: dict[str, int] = defaultdict(int)
        self.seconds: dict[str, float] = defaultdict(float)
        self.publishing = 0.0

    def around(self, name: str, function: Any) -> Any:
        def timed(*arguments: Any) -> Any:
            begun, published = time.perf_counter(), self.publishing
            try:
                return function(*arguments)
            finally:
                self.calls[name] += 1
                self.seconds[name] += time.perf_counter() - begun - (self.publishing - published)

        return timed

    def install(self) -> None:
        listen, publish = node_module.GraphNode.listen, Publisher.publish
        subscribe = recorder_module.RecorderNode.create_subscription

        def timed_listen(this: Any, topic: Any, handler: Any, raw: bool = False) -> Any:
            return listen(
                this, topic, self.around(f"{this.get_name()}: {topic.name}", handler), raw
            )

        def timed_publish(this: Any, message: Any) -> None:
            begun = time.perf_counter()
            publish(this, message)
            self.publishing += time.perf_counter() - begun
            self.calls["publish: serialise and send"] += 1

        def timed_subscribe(
            this: Any, kind: Any, name: str, callback: Any, *rest: Any, **keys: Any
        ) -> Any:
            return subscribe(
                this, kind, name, self.around("isogal_recorder: write", callback), *rest, **keys
            )

        node_module.GraphNode.listen = timed_listen  # type: ignore[method-assign]
        recorder_module.RecorderNode.create_subscription = timed_subscribe
        Publisher.publish = timed_publish


def where_time_goes(scenario: Scenario, folder: Path) -> dict[str, Any]:
    clocks = Clocks()
    clocks.install()
    wall = in_one_process(scenario, folder)["wall_s"]
    clocks.seconds["publish: serialise and send"] = clocks.publishing
    rest = wall - sum(clocks.seconds.values())
    clocks.seconds["executor: take, decode, dispatch (the rest)"] = rest
    rows = sorted(clocks.seconds.items(), key=lambda item: -item[1])
    return {
        "wall_s": wall,
        "parts": [
            {"part": name, "calls": clocks.calls[name], "seconds": seconds}
            for name, seconds in rows
        ],
    }


def show(result: dict[str, Any]) -> None:
    simulated = result["simulated_s"]
    processes, one, parts = result["processes"], result["in_process"], result["where_time_goes"]

    def speed(wall: float) -> str:
        return f"{wall:7.1f} s   {simulated / wall:6.0f} x real time"

    print(
        f"Scenario of {simulated:.0f} s, {psutil.cpu_count()} processors, load before the start"
        f" {result['load']:.1f}\n"
    )
    print(
        f"four processes and recorder {speed(processes['wall_s'])}  "
        f" ({processes['with_start_and_end_s']:.1f} s with start and end)"
    )
    for name, usage in processes["processes"].items():
        print(
            f"  {name:<25} {usage['cpu_s']:7.1f} s of processor   {usage['rss_mb']:6.0f} MB"
            " resident at most"
        )
    print(
        f"one process                 {speed(one['wall_s'])}   {one['rss_mb']:6.0f} MB resident\n"
    )
    print(f"Where the time goes in one process ({parts['wall_s']:.1f} s with the clocks on):")
    for row in parts["parts"]:
        each = (
            f"{row['seconds'] / row['calls'] * 1e6:8.0f} us each of {row['calls']}"
            if row["calls"]
            else ""
        )
        print(f"  {row['seconds']:7.2f} s  {row['part']:<44} {each}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, help="s to simulate; default: the scenario's")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a key of the scenario",
    )
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    changes = options.set + ([f"route.duration={options.duration}"] if options.duration else [])
    scenario = load_scenario(None, changes)
    from isogal.fields.scenario_map import map_for_scenario
    from isogal.sensors.trajectory import build_trajectory

    trajectory = build_trajectory(scenario)
    map_for_scenario(scenario, trajectory)  # made once, so that no run makes it
    result: dict[str, Any] = {
        "simulated_s": float(trajectory.time[-1]),
        "load": psutil.getloadavg()[0],
    }
    with tempfile.TemporaryDirectory() as folder:
        result["processes"] = as_processes(scenario, Path(folder))
        result["in_process"] = in_one_process(scenario, Path(folder))
        result["where_time_goes"] = where_time_goes(scenario, Path(folder))
    if options.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)


if __name__ == "__main__":
    main()
