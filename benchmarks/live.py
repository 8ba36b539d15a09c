"""The graph at real time: processor time, memory and latency of each node, rates of its topics.

    .venv/bin/python benchmarks/live.py [--minutes 20] [--rate 200] [--graphs 1]
        [--set KEY=VALUE ...] [--page FILE.md]

Runs the nodes of a real vehicle and a recorder as processes, publishes to them the samples of a
simulated IMU of `--rate` Hz and gravimeter, each when it is due, and listens beside them. With
`--graphs` there are several of them in one domain, each in a namespace of its own. The
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
import psutil
from graph import Usage
from rclpy.executors import SingleThreadedExecutor

from gravimeter_node.node import simulated_readings
from isogal.fields.simulated_vehicle import simulate_vehicle
from isogal.scenario import Scenario, load_scenario
from isogal_ros import topics
from isogal_ros.graph.domain import graph_domain, quiet_node
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.running import Processes
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.frames import BASE, framed
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.prepared import Prepared, peek_ns
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.signals import interrupts
from isogal_ros.topics import LOSSLESS, Topic

PATIENCE = 120.0
"""s in which the nodes must listen."""
WARM = 60.0
"""s that are not counted."""
Graphs = dict[str, Processes]
"""Each by its namespace."""
Times = dict[int, int]
"""When the first message of each stamp was published, ns."""


class Driver:
    """Publishes what the sensors of a simulated vehicle measure, when it is due."""

    def __init__(self, scenario: Scenario) -> None:
        vehicle, self._adapter = simulate_vehicle(scenario, scenario.true, 0), adapter_of(scenario)
        samples = vehicle.samples.reshape(-1, 6)
        times = (1.0 + np.arange(len(samples))) / scenario.imu.rate
        self._samples = list(zip(times.tolist(), samples[:, :3], samples[:, 3:], strict=True))
        self._readings, _ = simulated_readings(scenario, 0)
        self._variance = scenario.gravimeter.sigma**2

    def drive(self, domain: int, graphs: Graphs, look: Callable[[float], None]) -> None:
        """Publish all; `look` is called with the time (s) after each `WARM` seconds."""
        with quiet_node("isogal_live_driver", domain) as node:
            imu, raw = (
                [node.create_publisher(one.type, named(space, one), LOSSLESS) for space in graphs]
                for one in (topics.IMU, self._adapter.raw)
            )
            # a node and the recorder, and of the IMU this process
            needed = dict.fromkeys(imu, 3) | dict.fromkeys(raw, 2)
            end = time.monotonic() + PATIENCE
            while any(one.get_subscription_count() < count for one, count in needed.items()):
                ended = {space: one.ended() for space, one in graphs.items()}
                assert not any(ended.values()) and time.monotonic() < end, ended
                time.sleep(0.1)
            time.sleep(5.0)
            message, begun = Prepared(framed(topics.IMU, BASE)), time.monotonic()
            for seconds, force, turn in self._samples:
                time.sleep(max(0.0, begun + seconds - time.monotonic()))
                ns = from_seconds(seconds)
                fill_imu(message, ns, force, turn)
                for publisher in imu:
                    publisher.publish(message.serialised())
                if (reading := self._readings.get(ns)) is not None:
                    for publisher in raw:
                        publisher.publish(self._adapter.write_raw(*reading, self._variance, None))
                if seconds % WARM == 0.0:
                    look(seconds)
            for processes in graphs.values():
                assert not processes.ended(), processes.ended()


def named(space: str, topic: Topic) -> str:
    """Return the name of a topic of the graph in a namespace."""
    return f"/{space}/{topic.name}" if space else topic.name


class Listener(threading.Thread):
    """Notes when the messages of some topics in some namespaces have been published."""

    def __init__(self, domain: int, spaces: list[str], heard: tuple[Topic, ...]) -> None:
        super().__init__(daemon=True)
        self.done, self.domain = threading.Event(), domain
        self.times: dict[tuple[str, Topic], Times] = {
            (space, topic): {} for space in spaces for topic in heard
        }
        self.diagnostics: defaultdict[str, list[int]] = defaultdict(list)
        """When each node has said how it is, ns."""

    def run(self) -> None:
        with quiet_node("isogal_live_benchmark", self.domain) as node:
            for (space, topic), times in self.times.items():
                node.create_subscription(
                    topic.type, named(space, topic), self._noting(times), LOSSLESS, raw=True
                )
            node.create_subscription(
                topics.DIAGNOSTICS.type, topics.DIAGNOSTICS.name, self._note_diagnostics, LOSSLESS
            )
            executor = SingleThreadedExecutor(context=node.context)
            executor.add_node(node)
            while not self.done.is_set():
                executor.spin_once(timeout_sec=0.2)
            executor.shutdown()

    def _noting(self, times: Times) -> Any:
        def note(data: bytes, info: dict[str, int]) -> None:
            times.setdefault(peek_ns(data), info["source_timestamp"])

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


def measured(minutes: float, hertz: float, keys: list[str], count: int) -> dict[str, Any]:
    """Run so many graphs; return what was measured."""
    spaces = [f"vehicle_{k + 1}" for k in range(count)] if count > 1 else [""]
    duration = WARM + 60.0 * minutes
    scenario = load_scenario(None, [f"imu.rate={hertz}", f"route.duration={duration}", *keys])
    reduced = adapter_of(scenario).reduced
    nav = topics.NAV_ODOM, topics.NAV_FIX, topics.NAV_PATH
    driver, graphs, load = Driver(scenario), Graphs(), []
    usage = Usage(
        lambda: {
            f"{space}/{name}".lstrip("/"): psutil.Process(process.pid)
            for space, one in graphs.items()
            for name, process in one.running.items()
        }
    )

    def look(seconds: float) -> None:
        usage.look(seconds)
        load.append(os.getloadavg()[0])

    with (
        tempfile.TemporaryDirectory() as name,
        interrupts() as interrupt,
        graph_domain(scenario) as domain,
    ):
        listener = Listener(domain, spaces, (topics.IMU, *nav, reduced, topics.FIX))
        listener.start()
        try:
            for space in spaces:
                plan = Plan(scenario, Path(name) / space / "bag", real=True)
                graphs[space] = Processes(plan, Path(name) / space / "log", domain, space)
            driver.drive(domain, graphs, look)
        finally:
            for processes in graphs.values():
                processes.stop(interrupt)
    listener.done.set()
    listener.join()
    seconds = duration - WARM
    return {
        "minutes": minutes,
        "imu_hz": hertz,
        "load_average": float(np.mean(load)),
        "nodes": {
            name: {"cpu_percent": 0.1 * ms, "memory_mb": usage.peak[name]}
            for name, ms in sorted(usage.per_step.items())  # a step of a second
        },
        "latency_ms": latencies(listener.times, spaces, reduced),
        "rate_hz": {
            named(space, topic): rate(one, seconds)
            for (space, topic), one in listener.times.items()
        },
        "diagnostics_hz": {
            name: (len(one) - 1) / (1e-9 * (one[-1] - one[0]))
            for name, one in sorted(listener.diagnostics.items())
            if len(one) > 10
        },
    }


def latencies(
    times: dict[tuple[str, Topic], Times], spaces: list[str], reduced: Topic
) -> dict[str, dict[str, float] | None]:
    """Return the latencies of odometry and fixes of each graph, whose readings are on a topic."""
    late: dict[str, dict[str, float] | None] = {}
    for space in spaces:
        imu, odom, reading, fix = (
            times[space, topic] for topic in (topics.IMU, topics.NAV_ODOM, reduced, topics.FIX)
        )
        where = f" of {space}" if space else ""
        late[f"nav/odom after imu/data_raw{where}"] = latency(odom, imu)
        late[f"pmht_mm/fix after the last reading{where}"] = latency(fix, reading)
    return late


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
    parser.add_argument("--graphs", type=int, default=1, help="in one domain, in namespaces")
    parser.add_argument("--page", type=Path, help="page to write")
    parser.add_argument("--note", default="", help="what else is to be said on the page")
    options = parser.parse_args()
    found = measured(options.minutes, options.rate, options.set, options.graphs)
    print(json.dumps(found, indent=2))
    if options.page is not None:
        options.page.write_text(page(found, options.note), encoding="utf-8")


if __name__ == "__main__":
    main()
