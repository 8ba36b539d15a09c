"""A bench for single nodes: feeds them messages and hears what they answer, over DDS, in this
process."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node

from isogal import plugins
from isogal.fields.measured import measured_field, of_instrument
from isogal.inertial.error_state import BATCH
from isogal.inertial.rotations import from_heading
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.graph.domain import claim_domain, local_context
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import Outcome, Plan, node_class
from isogal_ros.messages.adapter import adapter_of, all_topics
from isogal_ros.messages.frames import BASE, MAP, map_frame
from isogal_ros.messages.gravimeter import PLATFORM, GravimeterAdapter
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.odometry import fill_odom
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamped_numbers import fill_numbers
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes.health import figures_of
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.nodes.spin import make_executor
from isogal_ros.parameters.values import node_values
from isogal_ros.topics import Topic

PATIENCE = 60.0
"""How long a test waits for what must come (s of wall time)."""

ENDPOINTS = 4
"""How often an endpoint is created that its peer does not find."""

NOT_IN_USE = (topics.INITIAL_POSE, topics.BAROMETER, topics.VELOCITY, topics.SCALAR_FIELD)
"""Topics that nobody publishes in a graph without such sensors, whose start is known."""


def topics_of(scenario: Scenario) -> list[Topic]:
    """Topics that the graph of a scenario publishes: not those of other instruments."""
    fields = of_instrument(measured_field(scenario).instrument)
    own = {adapter_of(scenario, field.name) for field in fields}
    wanted = {topic for adapter in own for topic in (adapter.raw, adapter.reduced)}
    of_instruments = {*topics.OF_INSTRUMENTS}
    for name in plugins.names(plugins.MESSAGE_ADAPTERS):
        adapter = adapter_of(scenario, name)
        of_instruments |= {adapter.raw, adapter.reduced}
    return [
        topic
        for topic in all_topics(scenario)
        if topic not in NOT_IN_USE and (topic in wanted or topic not in of_instruments)
    ]


def absolute(topic: Topic) -> str:
    """A topic's name as a bag has it."""
    return "/" + topic.name.lstrip("/")


def stamps(bench: "Bench", topic: Topic) -> list[int]:
    """Stamps of the messages that a bench has heard on a topic, whole seconds."""
    return [to_ns(message.header.stamp) // 10**9 for message in bench.heard[topic.name]]


def vector_reading(scenario: Scenario, seconds: float, values: Sequence[float]) -> Any:
    """A raw message of an instrument with several channels, of 1e-9 1-sigma each."""
    adapter = adapter_of(scenario)
    message = adapter.new_raw()
    covariance = 1e-18 * np.eye(len(values))
    adapter.fill_raw(message, from_seconds(seconds), np.array(values), covariance)
    return message


class Bench:
    """One node under test and a probe."""

    def __init__(self, context: Any, name: str, scenario: Scenario, **own: Any) -> None:
        self.executor = make_executor(context)
        values = node_values(scenario, {"peers": [name]} | own, node_class(name).sections)
        self.node = node_class(name)(name, values=values, context=context)
        self.probe = Node("probe", context=context, use_global_arguments=False)
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self.publishers: dict[str, Any] = {}
        self.clients: dict[str, Any] = {}
        for topic in all_topics(scenario):
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
        self.publisher(topic).publish(message)

    def publisher(self, topic: Topic) -> Any:
        """Return a publisher that the node listens to."""
        if topic.name not in self.publishers:
            self.publishers[topic.name] = self._discovered(
                lambda: self.probe.create_publisher(topic.type, topic.name, topics.LOSSLESS),
                lambda made: made.get_subscription_count() >= 2,  # the probe hears itself as well
                self.probe.destroy_publisher,
                f"listeners of {topic.name}",
            )
        return self.publishers[topic.name]

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Return what a service of the node answers. Its client is kept: one that comes and goes
        is at times not found any more."""
        if name not in self.clients:
            self.clients[name] = self._discovered(
                lambda: self.probe.create_client(kind, f"{self.node.get_name()}/{name}"),
                lambda made: made.service_is_ready(),
                self.probe.destroy_client,
                f"service {name}",
            )
        answer = self.clients[name].call_async(request)
        self.wait(answer.done, f"the answer of {name}")
        return answer.result()

    def _discovered(
        self,
        create: Callable[[], Any],
        ready: Callable[[Any], bool],
        destroy: Callable[[Any], Any],
        what: str,
    ) -> Any:
        """Return an endpoint that its peer has found. On a loaded machine the middleware now and
        then misses one for good: it is then created anew."""
        for _ in range(ENDPOINTS):
            made, end = create(), time.monotonic() + PATIENCE / ENDPOINTS
            while time.monotonic() < end:
                if ready(made):
                    return made
                self.executor.spin_once(timeout_sec=0.05)
            destroy(made)
        raise AssertionError(f"waited in vain for {what}")

    def imu(
        self,
        seconds: float,
        force: Sequence[float] = (0.0, 0.0, -9.8),
        rate: Sequence[float] = (0.0, 0.0, 0.0),
        **changes: Any,
    ) -> None:
        """Publish an IMU sample, FRD."""
        message = topics.IMU.type()
        message.header.frame_id = changes.pop("frame", BASE)
        assert not changes
        fill_imu(message, from_seconds(seconds), np.array(force), np.array(rate))
        self.publish(topics.IMU, message)

    def fix(
        self,
        seconds: float,
        latitude: float,
        longitude: float,
        variance: float = 100.0,
        frame: str = BASE,
        **keys: Any,
    ) -> None:
        """Publish a fix, rad."""
        message = topics.FIX.type()
        message.header.frame_id = frame
        fill_fix(
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
            topics.NAV_ODOM.type(child_frame_id=BASE),
            topics.NAV_COVARIANCE.type(),
        )
        fix.header.frame_id, odom.header.frame_id = BASE, MAP
        matrix = np.diag([900.0, 900.0, 0.01, 0.01, 0.01, 1e-4, 1e-10, 1e-10, 1e-8])
        state = np.array([latitude, longitude, 100.0, *velocity, 0.0, *from_heading(0.8)])
        fill_fix(fix, ns, latitude, longitude, 100.0, matrix[:3, :3])
        fill_odom(odom, ns, map_frame(self.scenario), state, np.zeros(3), matrix)
        fill_numbers(cov, ns, matrix[np.ix_(BATCH, BATCH)])
        self.publish(topics.NAV_COVARIANCE, cov)
        self.publish(topics.NAV_FIX, fix)
        self.publish(topics.NAV_ODOM, odom)

    def reading(
        self,
        seconds: float,
        value: float,
        variance: float = 1e-10,
        frame: str = PLATFORM,
        topic: Topic | None = None,
    ) -> None:
        """Publish a reduced (or raw) reading."""
        topic = topic or adapter_of(self.scenario).reduced
        message = topic.type()
        message.header.frame_id = frame
        GravimeterAdapter(topic).fill_reduced(
            message, from_seconds(seconds), value, variance, None
        )
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
def bench(name: str, scenario: Scenario, **own: Any) -> Iterator[Bench]:
    """A bench with one node on it."""
    with claim_domain() as domain, local_context(domain) as context:
        made = Bench(context, name, scenario, **own)
        try:
            yield made
        finally:
            made.executor.shutdown()
            for node in (made.node, made.probe):
                node.destroy_node()
            # it keeps what it has had, and others would find that for as long as anybody, as the
            # traceback of a failed test, keeps the executor
            made.executor.shutdown()


def run_here(scenario: Scenario, bag: Path | None) -> Outcome:
    """Run the graph in this process to its end."""
    outcome = run_in_process(Plan(scenario, bag), Interrupt(), lambda progress: None)
    assert not outcome.interrupted
    return outcome
