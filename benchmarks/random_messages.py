"""Random messages to every callback of the nodes: no exception escapes, nothing not finite is
published, the memory stays.

    .venv/bin/python benchmarks/random_messages.py [--messages 100000] [--set KEY=VALUE ...]

As tests/ros/nodes/test_random_messages.py, whose messages these are, with many more of them, and
without the middleware (`isogal_ros.graph.bus`). A message of which a node had to say that it did
not foresee the exception is counted as a surprise."""

import json
import sys
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import closed_loop
import numpy as np
import psutil
from rclpy.serialization import deserialize_message

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from isogal.scenario import Scenario, load_scenario
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.faults.trials import UNEXPECTED, without_numbers
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.plan import node_class
from isogal_ros.messages.imu import fill_imu
from isogal_ros.parameters.values import node_values
from isogal_ros.topics import Topic
from ros.nodes.test_random_messages import MESSAGES, fed

LISTENED: dict[str, tuple[Topic, ...]] = {
    topics.UKF_FUSION: (topics.IMU, topics.FIX, topics.INFORMATION, topics.INITIAL_POSE),
    topics.PMHT_MM: (topics.NAV_FIX, topics.NAV_ODOM, topics.NAV_COVARIANCE, topics.GRAVITY),
    topics.GRAVIMETER: (topics.TRUTH_FIX, topics.NAV_FIX, topics.NAV_ODOM),
}
SECOND = 10**9


class Heard:
    """Counts published states that are not finite."""

    def __init__(self, bus: Bus) -> None:
        self.messages = self.not_finite = 0
        bus.hear(topics.NAV_FIX, self._fix)
        bus.hear(topics.NAV_ODOM, self._odometry)

    def _fix(self, data: bytes) -> None:
        fix = deserialize_message(data, topics.NAV_FIX.type)
        self._note([fix.latitude, fix.longitude, *fix.position_covariance])

    def _odometry(self, data: bytes) -> None:
        self._note(deserialize_message(data, topics.NAV_ODOM.type).pose.covariance)

    def _note(self, values: Any) -> None:
        self.messages += 1
        self.not_finite += not np.isfinite(values).all()


def one_node(scenario: Scenario, name: str, messages: int) -> dict[str, Any]:
    """Return what became of a node."""
    bus, memory, surprises = Bus(), [], Counter[str]()
    node = bus.add(name, node_values(scenario, {"peers": [name]}, node_class(name).sections))
    heard = Heard(bus)
    for k in range(1, 4 if name == topics.UKF_FUSION else 1):
        message = topics.IMU.type()
        message.header.frame_id = "base_link"
        fill_imu(message, k * SECOND, np.array([0.0, 0.0, -9.8]), np.zeros(3))
        bus.send(topics.IMU.name, message)
    bus.run()
    rounds = -(-messages // MESSAGES)
    for turn in range(rounds):
        for topic in LISTENED[name]:
            fed(node, topic, generator(turn, 0, f"random messages: {topic.name}"))
            bus.run()
        surprises.update(without_numbers(text) for text in bus.errors if UNEXPECTED.search(text))
        bus.errors.clear()
        bus.now += 1.0
        bus.tick()
        if turn % 50 == 49 or turn == rounds - 1:
            memory.append(psutil.Process().memory_info().rss / 1e6)
    return {
        "node": name,
        "messages_per_callback": rounds * MESSAGES,
        "dropped": node.health.dropped,
        "published": heard.messages,
        "not_finite": heard.not_finite,
        "surprises": dict(surprises),
        "ended": node.finished,
        "memory_mb": [round(memory[len(memory) // 2]), round(memory[-1])],
    }


def main() -> None:
    parser = closed_loop.parser(__doc__, "set")
    parser.add_argument("--messages", type=int, default=100_000, help="for each callback")
    options = parser.parse_args()
    scenario = load_scenario(None, options.set)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        rows = [one_node(scenario, name, options.messages) for name in LISTENED]
    print(json.dumps(rows, indent=2))
    raise SystemExit(any(row["ended"] or row["not_finite"] or row["surprises"] for row in rows))


if __name__ == "__main__":
    main()
