"""A bench for single nodes: feeds them messages and hears what they answer, over DDS, in this
process."""

import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node

from isogal.fields.measured import FIELDS, of_instrument
from isogal.inertial.error_state import BATCH
from isogal.inertial.rotations import from_heading
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.graph.domain import claim_domain
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import Plan, node_class
from isogal_ros.messages import convert
from isogal_ros.messages.readings import ADAPTERS
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import graph_values
from isogal_ros.nodes.health import figures_of
from isogal_ros.nodes.spin import Interrupt, local_context, make_executor
from isogal_ros.topics import Topic

PATIENCE = 60.0


def topics_of(field: str) -> list[Topic]:
    """Topics of a graph that measures a field: not those of other instruments."""
    instruments = {name: {adapter.raw, adapter.reduced} for name, adapter in ADAPTERS.items()}
    own = set().union(
        *(instruments[other.name] for other in of_instrument(FIELDS[field].instrument))
    )
    others = set().union(*instruments.values()) - own
    return [topic for topic in topics.ALL if topic not in others]


class Bench:
    """One node under test and a probe."""

    def __init__(self, context: Any, name: str, scenario: Scenario, **own: Any) -> None:
        self.executor = make_executor(context)
        values = graph_values(scenario, {"peers": [name]} | own, node_class(name).sections)
        self.node = node_class(name)(name, values=values, context=context)
        self.probe = Node("probe", context=context, use_global_arguments=False)
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self.publishers: dict[str, Any] = {}
        for topic in topics.ALL:
            self.probe.create_subscription(
                topic.type, topic.name, self.heard[topic.name].append, topics.LOSSLESS
            )
        for node in (self.node, self.probe):
            self.executor.add_node(node)
        self.scenario = scenario

    def wait(self, condition: Callable[[], Any], what: str = "the node's answer") -> None:
        """Spin until the condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f"waited in vain for {what}"
            self.executor.spin_once(timeout_sec=0.05)

    def settle(self, seconds: float = 0.3) -> None:
        """Spin until nothing happens any more."""
        end = time.monotonic() + seconds
        count = -1
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)
            if (now := sum(map(len, self.heard.values()))) != count:
                count, end = now, time.monotonic() + seconds

    def publish(self, topic: Topic, message: Any) -> None:
        """Publish one message to the node."""
        if topic.name not in self.publishers:
            publisher = self.publishers[topic.name] = self.probe.create_publisher(
                topic.type, topic.name, topics.LOSSLESS
            )
            # the probe hears itself as well
            self.wait(
                lambda: publisher.get_subscription_count() >= 2, f"listeners of {topic.name}"
            )
        self.publishers[topic.name].publish(message)

    def imu(
        self, seconds: float, force: tuple[float, float, float] = (0.0, 0.0, -9.8), **changes: Any
    ) -> None:
        """Publish an IMU sample, FRD."""
        message = topics.IMU.type()
        message.header.frame_id = changes.pop("frame", convert.BASE)
        assert not changes
        convert.fill_imu(message, from_seconds(seconds), np.array(force), np.zeros(3))
        self.publish(topics.IMU, message)

    def fix(
        self,
        seconds: float,
        latitude: float,
        longitude: float,
        variance: float = 100.0,
        frame: str = convert.BASE,
        **keys: Any,
    ) -> None:
        """Publish a fix, rad."""
        message = topics.FIX.type()
        message.header.frame_id = frame
        convert.fill_fix(
            message,
            from_seconds(seconds),
            latitude,
            longitude,
            100.0,
            np.diag([variance, variance, 1e6]),
            **keys,
        )
        self.publish(topics.FIX, message)

    def nav(
        self,
        seconds: float,
        latitude: float,
        longitude: float,
        velocity: tuple[float, float] = (10.0, 10.0),
    ) -> None:
        """Publish what a navigator says."""
        ns = from_seconds(seconds)
        fix, odom, cov = (
            topics.NAV_FIX.type(),
            topics.NAV_ODOM.type(child_frame_id=convert.BASE),
            topics.NAV_COVARIANCE.type(),
        )
        fix.header.frame_id, odom.header.frame_id = convert.BASE, convert.MAP
        matrix = np.diag([900.0, 900.0, 0.01, 0.01, 0.01, 1e-4, 1e-10, 1e-10, 1e-8])
        state = np.array([latitude, longitude, 100.0, *velocity, 0.0, *from_heading(0.8)])
        convert.fill_fix(fix, ns, latitude, longitude, 100.0, matrix[:3, :3])
        convert.fill_odom(odom, ns, convert.map_frame(self.scenario), state, np.zeros(3), matrix)
        convert.fill_numbers(cov, ns, matrix[np.ix_(BATCH, BATCH)])
        self.publish(topics.NAV_COVARIANCE, cov)
        self.publish(topics.NAV_FIX, fix)
        self.publish(topics.NAV_ODOM, odom)

    def reading(
        self,
        seconds: float,
        value: float,
        variance: float = 1e-10,
        frame: str = convert.PLATFORM,
        topic: Topic | None = None,
    ) -> None:
        """Publish a reduced (or raw) reading."""
        topic = topic or topics.readings(self.scenario.measured_field)
        message = topic.type()
        message.header.frame_id = frame
        convert.fill_accel(message, from_seconds(seconds), value, variance)
        self.publish(topic, message)

    def says(self) -> list[tuple[bytes, str, dict[str, str]]]:
        """Return what the node said about itself: level, message, figures."""
        items = [item for array in self.heard[topics.DIAGNOSTICS.name] for item in array.status]
        return [
            (item.level, item.message, figures_of(item))
            for item in items
            if not item.name.endswith("batch")
        ]


@contextmanager
def bench(name: str, scenario: Scenario, **own: Any):
    """A bench with one node on it."""
    with claim_domain() as domain, local_context(domain) as context:
        made = Bench(context, name, scenario, **own)
        try:
            yield made
        finally:
            for node in (made.node, made.probe):
                made.executor.remove_node(node)
                node.destroy_node()


def run_here(scenario: Scenario, bag: Path | None) -> Any:
    """Run the graph in this process to its end."""
    outcome = run_in_process(Plan(scenario, bag), Interrupt(), lambda progress: None)
    assert not outcome.interrupted
    return outcome
