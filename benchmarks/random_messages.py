"""Random messages to every callback of the nodes: no exception escapes, nothing not finite is
published, the memory stays.

    .venv/bin/python benchmarks/random_messages.py [--messages 100000] [--set KEY=VALUE ...]

As tests/ros/nodes/test_random_messages.py, whose messages these are, with many more of them."""

import argparse
import json
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from helpers.node_bench import Bench, bench
from isogal.scenario import Scenario, load_scenario
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.topics import Topic
from ros.nodes.test_random_messages import MESSAGES, fed

LISTENED: dict[str, tuple[Topic, ...]] = {
    topics.UKF_FUSION: (topics.IMU, topics.FIX, topics.INFORMATION, topics.INITIAL_POSE),
    topics.PMHT_MM: (topics.NAV_FIX, topics.NAV_ODOM, topics.NAV_COVARIANCE, topics.GRAVITY),
    topics.GRAVIMETER: (topics.TRUTH_FIX, topics.NAV_FIX, topics.NAV_ODOM),
}


def not_finite(made: Bench) -> int:
    """Count published states that are not finite, and forget what was heard."""
    bad = sum(
        not np.isfinite([fix.latitude, fix.longitude, *fix.position_covariance]).all()
        for fix in made.heard[topics.NAV_FIX.name]
    )
    bad += sum(
        not np.isfinite(odometry.pose.covariance).all()
        for odometry in made.heard[topics.NAV_ODOM.name]
    )
    for heard in made.heard.values():
        heard.clear()
    return bad


def one_node(scenario: Scenario, name: str, messages: int) -> dict[str, Any]:
    """Return what became of a node."""
    bad, memory = 0, []
    with bench(name, scenario) as made:
        if name == topics.UKF_FUSION:
            for k in range(1, 4):
                made.imu(k)
            made.settle()
        rounds = -(-messages // MESSAGES)
        for turn in range(rounds):
            for topic in LISTENED[name]:
                fed(made, topic, generator(turn, 0, f"random messages: {topic.name}"))
                made.settle(0.01)
            if turn % 50 == 49 or turn == rounds - 1:
                made.settle(0.1)
                bad += not_finite(made)
                memory.append(psutil.Process().memory_info().rss / 1e6)
        return {
            "node": name,
            "messages_per_callback": rounds * MESSAGES,
            "dropped": made.node.health.dropped,
            "not_finite": bad,
            "ended": made.node.finished,
            "memory_mb": [round(memory[len(memory) // 2]), round(memory[-1])],
        }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--messages", type=int, default=100_000, help="for each callback")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    scenario = load_scenario(None, options.set)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        rows = [one_node(scenario, name, options.messages) for name in LISTENED]
    print(json.dumps(rows, indent=2))
    raise SystemExit(any(row["ended"] or row["not_finite"] for row in rows))


if __name__ == "__main__":
    main()
