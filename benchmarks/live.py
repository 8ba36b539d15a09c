"""The graph at real time: processor time, memory and latency of each node, rates of its topics.

    .venv/bin/python benchmarks/live.py [--minutes 20] [--rate 200] [--set KEY=VALUE ...]
        [--page FILE.md]

Runs the four nodes and a recorder as processes, not in lock-step, with an IMU of `--rate` Hz, and
listens beside them. The latency of nav/odom is from when the simulator has published the sample of
its stamp until the filter has published the odometry, both as the middleware has noted it; that of
a fix is from its last reading. The first minute is not counted. What else the machine does counts:
say how busy it was."""

import json
import os
import tempfile
import threading
from collections import defaultdict
from pathlib import Path
from typing import Any

import closed_loop
import numpy as np
from graph import Usage
from rclpy.executors import SingleThreadedExecutor

from isogal.scenario import load_scenario
from isogal_ros import topics
from isogal_ros.graph.domain import quiet_node
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.running import Processes, run_processes
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.stamps import peek_ns
from isogal_ros.nodes.signals import interrupts
from isogal_ros.topics import LOSSLESS, Topic

WARM = 60.0
"""s that are not counted."""
Times = dict[int, int]
"""When the first message of each stamp was published, ns."""


class Listener(threading.Thread):
    """Notes when the messages of some topics have been published."""

    def __init__(self, heard: tuple[Topic, ...]) -> None:
        super().__init__(daemon=True)
        self.done, self.domain, self._topics = threading.Event(), 0, heard
        self.times: dict[Topic, Times] = {topic: {} for topic in heard}
        self.diagnostics: defaultdict[str, list[int]] = defaultdict(list)
        """When each node has said how it is, ns."""

    def run(self) -> None:
        with quiet_node("isogal_live_benchmark", self.domain) as node:
            for topic in self._topics:
                node.create_subscription(
                    topic.type, topic.name, self._noting(topic), LOSSLESS, raw=True
                )
            node.create_subscription(
                topics.DIAGNOSTICS.type, topics.DIAGNOSTICS.name, self._note_diagnostics, LOSSLESS
            )
            executor = SingleThreadedExecutor(context=node.context)
            executor.add_node(node)
            while not self.done.is_set():
                executor.spin_once(timeout_sec=0.2)
            executor.shutdown()

    def _noting(self, topic: Topic) -> Any:
        def note(data: bytes, info: dict[str, int]) -> None:
            self.times[topic].setdefault(peek_ns(data), info["source_timestamp"])

        return note

    def _note_diagnostics(self, message: Any, info: dict[str, int]) -> None:
        for item in message.status:
            self.diagnostics[item.name].append(info["source_timestamp"])


def figures(late: list[float]) -> dict[str, float]:
    """Return figures of latencies, ms."""
    return {
        "messages": len(late),
        "p50": float(np.median(late)),
        "p99": float(np.quantile(late, 0.99)),
        "largest": max(late),
    }


def latency(ends: Times, begins: Times) -> dict[str, float] | None:
    """Return how much later (ms) messages were published than those of their stamps on another
    topic, after `WARM`; None = there is none."""
    later = {ns: at for ns, at in ends.items() if ns in begins and ns > WARM * 1e9}
    late = [1e-6 * (at - begins[ns]) for ns, at in later.items()]
    return figures(late) if late else None


def rate(times: Times, seconds: float) -> float:
    """Return messages a second of stamps after `WARM`."""
    return sum(ns > WARM * 1e9 for ns in times) / seconds


def measured(minutes: float, hertz: float, keys: list[str]) -> dict[str, Any]:
    """Run the graph; return what was measured."""
    duration = WARM + 60.0 * minutes
    scenario = load_scenario(None, [f"imu.rate={hertz}", f"route.duration={duration}", *keys])
    reduced = adapter_of(scenario).reduced
    nav = topics.NAV_ODOM, topics.NAV_FIX, topics.NAV_PATH
    listener = Listener((topics.IMU, *nav, reduced, topics.FIX))
    usage, warm, load = Usage(), {}, []

    def announce(domain: int) -> None:
        listener.domain = domain
        listener.start()
        usage.start()

    def look(_processes: Processes, simulated: float) -> None:
        if simulated >= WARM and not warm:
            warm.update(usage.seconds)
        load.append(os.getloadavg()[0])

    with tempfile.TemporaryDirectory() as name, interrupts() as interrupt:
        plan = Plan(scenario, Path(name) / "bag", rate=1.0, lock_step=False)
        run_processes(plan, Path(name) / "log", interrupt, announce=announce, inject=look)
    usage.done.set()
    listener.done.set()
    listener.join()
    times = listener.times
    seconds = duration - WARM
    return {
        "minutes": minutes,
        "imu_hz": hertz,
        "load_average": float(np.median(load)),
        "nodes": {
            name: {
                "cpu_percent": 100.0 * (spent - warm.get(name, 0.0)) / seconds,
                "memory_mb": usage.peak[name],
            }
            for name, spent in sorted(usage.seconds.items())
        },
        "latency_ms": {
            "nav/odom after imu/data_raw": latency(times[topics.NAV_ODOM], times[topics.IMU]),
            "pmht_mm/fix after the last reading": latency(times[topics.FIX], times[reduced]),
        },
        "rate_hz": {topic.name: rate(one, seconds) for topic, one in times.items()},
        "diagnostics_hz": {
            name: (len(one) - 1) / (1e-9 * (one[-1] - one[0]))
            for name, one in sorted(listener.diagnostics.items())
            if len(one) > 10
        },
    }


def page(found: dict[str, Any]) -> str:
    """Return the figures as a page."""
    lines = [
        "# Live: the graph at real time",
        "",
        f"Made by `benchmarks/live.py --minutes {found['minutes']:g} --page"
        " docs/evidence/live.md`: the four nodes and a recorder as processes,"
        f" {found['imu_hz']:g} Hz of IMU, not in lock-step, on a machine with {os.cpu_count()}"
        f" cores whose load average was {found['load_average']:.1f} (median; 1 to 2 is the graph"
        " alone). What is said of each is in the script's first lines.",
        "",
        "| node | share of a core | memory, MB |",
        "|---|---|---|",
        *(
            f"| `{name}` | {one['cpu_percent']:.1f} % | {one['memory_mb']:.0f} |"
            for name, one in found["nodes"].items()
        ),
        "",
        "| latency | messages | p50, ms | p99, ms | largest, ms |",
        "|---|---|---|---|---|",
        *(
            f"| {name} | {one['messages']} | {one['p50']:.1f} | {one['p99']:.1f} |"
            f" {one['largest']:.0f} |"
            for name, one in found["latency_ms"].items()
            if one is not None
        ),
        "",
        "| topic | messages a second |",
        "|---|---|",
        *(f"| `{name}` | {one:.2f} |" for name, one in found["rate_hz"].items()),
        *(
            f"| `/diagnostics` of {name} | {one:.2f} |"
            for name, one in found["diagnostics_hz"].items()
        ),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = closed_loop.parser(__doc__, "set")
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--rate", type=float, default=200.0, help="of the IMU, Hz")
    parser.add_argument("--page", type=Path, help="page to write")
    options = parser.parse_args()
    found = measured(options.minutes, options.rate, options.set)
    print(json.dumps(found, indent=2))
    if options.page is not None:
        options.page.write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    main()
