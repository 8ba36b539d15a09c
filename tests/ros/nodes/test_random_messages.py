"""No callback lets an exception out, whatever a message holds, and nothing not finite is
published."""

import math
from typing import Any

import numpy as np
import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import serialize_message

from helpers.node_bench import bench
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.graph.bus import Bus
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.topics import Topic

MESSAGES = 60
ODD = (0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, -1e300, 9.8, 90.0, math.nan, math.inf, -math.inf)


def fill(message: Any, rng: np.random.Generator) -> None:
    """Put odd numbers, frames and stamps into some of a message's fields."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            fill(value, rng)
        elif rng.random() < 0.3:
            continue
        elif kind == "double":
            setattr(message, name, float(rng.choice(ODD)))
        elif kind.startswith("double["):
            setattr(message, name, rng.choice(ODD, len(value)))
        elif kind == "sequence<double>":
            setattr(message, name, rng.choice(ODD, int(rng.integers(0, 80))).tolist())
        elif kind == "string":
            setattr(message, name, str(rng.choice(["base_link", "map", "gravimeter_link", ""])))
        elif kind == "sequence<uint8>":
            setattr(message, name, rng.bytes(int(rng.integers(0, 300))))
        elif kind in ("uint32", "uint8", "uint16"):
            setattr(message, name, int(rng.integers(0, 200)))


def fed(node: Any, topic: Topic, rng: np.random.Generator) -> None:
    """Hand messages to a node's callback as the executor does."""
    for i in range(MESSAGES):
        message = topic.type()
        fill(message, rng)
        if hasattr(message, "header"):
            set_stamp(
                message.header.stamp, int(rng.choice([0, i * 10**9, 2**61])) % (2**31 * 10**9)
            )
        node.listening[topic.name].deliver(serialize_message(message))


@pytest.mark.parametrize(
    ("name", "listened"),
    [
        (topics.UKF_FUSION, (topics.IMU, topics.FIX, topics.INFORMATION, topics.INITIAL_POSE)),
        (topics.PMHT_MM, (topics.NAV_FIX, topics.NAV_ODOM, topics.NAV_COVARIANCE,
                          topics.DISTURBANCE)),
        (topics.GRAVIMETER, (topics.TRUTH_FIX, topics.NAV_FIX, topics.NAV_ODOM)),
    ],
)  # fmt: skip
def test_random_messages(scenario, name, listened) -> None:
    with bench(name, scenario()) as made:
        for k in range(1, 4):
            if name == topics.UKF_FUSION:
                made.imu(k)
        for turn in range(3):
            for topic in listened:
                fed(made.node, topic, generator(turn, 0, f"random messages: {topic.name}"))
        assert not made.node.finished
        assert made.node.health.dropped
        for fix in made.heard["nav/fix"]:
            assert np.isfinite([fix.latitude, fix.longitude, *fix.position_covariance]).all()
        for odometry in made.heard["nav/odom"]:
            assert np.isfinite(odometry.pose.covariance).all()


def test_a_listener_that_takes_nothing_does_not_end_a_node(scenario, monkeypatch) -> None:
    """A full history of a lossless topic; the diagnostics are held up as well."""
    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in range(1, 4):
            made.imu(k)
        with monkeypatch.context() as patch:

            def fail(bus: Bus, name: str, message: Any) -> None:
                raise rclpy_implementation.RCLError("Failed to publish: cannot publish data")

            patch.setattr(Bus, "send", fail)
            made.node.advertise(topics.NAV_PATH).publish(topics.NAV_PATH.type())
            made.node.advertise(topics.DIAGNOSTICS).publish(topics.DIAGNOSTICS.type())
        assert set(made.node.health.dropped) == {topics.NAV_PATH.name, topics.DIAGNOSTICS.name}
        assert made.told("takes nothing")
