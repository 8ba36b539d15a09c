"""The graph at real time: processor time, memory and latency of each node, rates of its topics.

    .venv/bin/python benchmarks/live.py [--minutes 20] [--rate 200] [--set KEY=VALUE ...]
        [--page FILE.md]

Runs the nodes of a real vehicle and a recorder as processes, publishes to them the samples of a
simulated IMU of `--rate` Hz and gravimeter, each when it is due, and listens beside them. The
latency of nav/odom is from when the sample of its stamp was published until the filter has
published the odometry, both as the middleware has noted it; that of a fix is from its last
reading. The first minute is not counted. What else the machine does counts: say how busy it
was."""

import json
import os
import shlex
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import closed_loop
import numpy as np
from graph import Usage, nodes_running
from rclpy.executors import SingleThreadedExecutor

from gravimeter_node.node import simulated_readings
from isogal.fields.simulated_vehicle import simulate_vehicle
from isogal.scenario import Scenario, load_scenario
from isogal_ros import topics
from isogal_ros.graph.domain import graph_domain, names_of, quiet_node
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.running import Processes
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.frames import BASE, framed
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.prepared import Prepared
from isogal_ros.messages.stamps import from_seconds, peek_ns
from isogal_ros.nodes.signals import interrupts
from isogal_ros.topics import LOSSLESS, Topic

PATIENCE = 120.0
"""s in which the nodes must listen."""
WARM = 60.0
"""s that are not counted."""
Times = dict[int, int]
"""When the first message of each stamp was published, ns."""


class Driver:
    """Publishes what the sensors of a simulated vehicle measure, when it is due."""

    def __init__(self, scenario: Scenario) -> None:
        vehicle, self._adapter = simulate_vehicle(scenario, 0), adapter_of(scenario)
        samples = vehicle.samples.reshape(-1, 6)
        times = (1.0 + np.arange(len(samples))) / scenario.imu.rate
        self._samples = list(zip(times.tolist(), samples[:, :3], samples[:, 3:], strict=True))
        self._readings, _ = simulated_readings(scenario, 0)
        self._variance = scenario.gravimeter.sigma**2

    def drive(self, domain: int, processes: Processes, look: Callable[[float], None]) -> None:
        """Publish all; `look` is called with the time (s) after each `WARM` seconds."""
        with quiet_node("isogal_live_driver", domain) as node:
            pair = topics.IMU, self._adapter.raw
            imu, raw = (node.create_publisher(one.type, one.name, LOSSLESS) for one in pair)
            end = time.monotonic() + PATIENCE
            # a node and the recorder, and of the IMU this process
            while imu.get_subscription_count() < 3 or raw.get_subscription_count() < 2:
                assert not processes.ended() and time.monotonic() < end, processes.ended()
                time.sleep(0.1)
            time.sleep(5.0)
            message, begun = Prepared(framed(topics.IMU, BASE)), time.monotonic()
            for seconds, force, turn in self._samples:
                time.sleep(max(0.0, begun + seconds - time.monotonic()))
                ns = from_seconds(seconds)
                fill_imu(message, ns, force, turn)
                imu.publish(message.serialised())
                if (reading := self._readings.get(ns)) is not None:
                    raw.publish(self._adapter.write_raw(*reading, self._variance, None))
                if seconds % WARM == 0.0:
                    look(seconds)
            assert not processes.ended(), processes.ended()


class Listener(threading.Thread):
    """Notes when the messages of some topics have been published."""

    def __init__(self, domain: int, heard: tuple[Topic, ...]) -> None:
        super().__init__(daemon=True)
        self.done, self.domain, self._topics = threading.Event(), domain, heard
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
    driver, usage, load = Driver(scenario), Usage(nodes_running), []

    def look(seconds: float) -> None:
        usage.look(seconds)
        load.append(os.getloadavg()[0])

    with (
        tempfile.TemporaryDirectory() as name,
        interrupts() as interrupt,
        graph_domain(names_of(scenario)) as domain,
    ):
        listener = Listener(domain, (topics.IMU, *nav, reduced, topics.FIX))
        listener.start()
        plan = Plan(scenario, Path(name) / "bag", real=True)
        processes = Processes(plan, Path(name) / "log", domain)
        try:
            driver.drive(domain, processes, look)
        finally:
            processes.stop(interrupt)
    listener.done.set()
    listener.join()
    times = listener.times
    seconds = duration - WARM
    return {
        "minutes": minutes,
        "imu_hz": hertz,
        "load_average": float(np.mean(load)),
        "nodes": {
            name: {"cpu_percent": 0.1 * ms, "memory_mb": usage.peak[name]}
            for name, ms in sorted(usage.per_step.items())  # a step of a second
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


def page(found: dict[str, Any], note: str) -> str:
    """Return the figures as a page."""
    lines = [
        "# Live: the graph at real time",
        "",
        f"Made by `benchmarks/live.py {shlex.join(sys.argv[1:])}`:"
        " the nodes of a real vehicle and a recorder as processes,"
        f" {found['imu_hz']:g} Hz of IMU, each sample published when it is due, on a machine with"
        f" {os.cpu_count()} cores whose load average was {found['load_average']:.1f}. What is"
        f" measured is said in the script's first lines. {note}".rstrip(),
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
        "",
        "The simulator of `isogal run --rate 1` publishes the samples of a step of 1 s together:"
        " beside it",
        "latencies are those of a burst, and mean nothing.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = closed_loop.parser(__doc__, "set")
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--rate", type=float, default=200.0, help="of the IMU, Hz")
    parser.add_argument("--page", type=Path, help="page to write")
    parser.add_argument("--note", default="", help="what else is to be said on the page")
    options = parser.parse_args()
    found = measured(options.minutes, options.rate, options.set)
    print(json.dumps(found, indent=2))
    if options.page is not None:
        options.page.write_text(page(found, options.note), encoding="utf-8")


if __name__ == "__main__":
    main()
