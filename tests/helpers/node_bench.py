"""A bench for single nodes: feeds them messages and hears what they answer, without
middleware."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import MagneticField

from isogal.inertial.error_state import BATCH
from isogal.inertial.rotations import from_heading
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.faults.campaign import Track, track_of
from isogal_ros.graph.bus import Bus, services
from isogal_ros.graph.plan import Plan, node_class
from isogal_ros.graph.player import Player
from isogal_ros.graph.running import run_in_process
from isogal_ros.messages.adapter import adapter_of, topics_in_use
from isogal_ros.messages.frames import BASE, MAP, map_frame
from isogal_ros.messages.gravimeter import PLATFORM, accelerations
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.odometry import fill_odom
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamped_numbers import fill_nav_covariance
from isogal_ros.messages.stamps import from_seconds, set_stamp, to_ns
from isogal_ros.nodes.health import OK, figures_of
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.parameters.values import node_values
from isogal_ros.topics import Topic

PATIENCE = 10.0
"""s of wall time that a test waits for what must come."""
UNSAID = topics.INITIAL_POSE, topics.SCALAR_FIELD, topics.NAV_AIDS
"""Topics that nobody publishes in a graph without aids, whose start is known."""


def topics_of(scenario: Scenario) -> list[Topic]:
    """Topics that the graph of a scenario without aids publishes."""
    return [topic for topic in topics_in_use(scenario) if topic not in UNSAID]


def absolute(topic: Topic) -> str:
    """A topic's name as a bag has it."""
    return "/" + topic.name.lstrip("/")


def stamps(bench: "Bench", topic: Topic) -> list[int]:
    """Stamps of the messages that a bench has heard on a topic, whole seconds."""
    return [to_ns(message.header.stamp) // 10**9 for message in bench.heard[topic.name]]


def vector_reading(scenario: Scenario, seconds: float, values: Sequence[float]) -> Any:
    """A raw message of an instrument with several channels, of 1e-9 1-sigma each."""
    covariance = 1e-18 * np.eye(len(values))
    write = adapter_of(scenario).write_raw
    return write(from_seconds(seconds), np.array(values), covariance, None)


def field_of(seconds: float, vector: Sequence[float], variance: float = 0.0) -> MagneticField:
    """What a magnetometer says, nT."""
    covariance = 1e-18 * variance * np.eye(3)
    message = MagneticField(magnetic_field_covariance=covariance.ravel())
    set_stamp(message.header.stamp, from_seconds(seconds))
    field = message.magnetic_field
    field.x, field.y, field.z = (1e-9 * float(part) for part in vector)
    return message


def nav_messages(
    scenario: Scenario,
    ns: int,
    latitude: float,
    longitude: float,
    velocity: tuple[float, float] = (10.0, 10.0),
    variance: float = 900.0,
) -> list[tuple[Topic, Any]]:
    """What a navigator says of a stamp: covariance, fix and odometry."""
    fix, odom, cov = (
        topics.NAV_FIX.type(),
        topics.NAV_ODOM.type(child_frame_id=BASE),
        topics.NAV_COVARIANCE.type(),
    )
    fix.header.frame_id, odom.header.frame_id = BASE, MAP
    matrix = np.diag([variance, variance, 0.01, 0.01, 0.01, 1e-4, 1e-10, 1e-10, 1e-8])
    state = np.array([latitude, longitude, 100.0, *velocity, 0.0, *from_heading(0.8)])
    fill_fix(fix, ns, latitude, longitude, 100.0, matrix[:3, :3])
    fill_odom(odom, ns, map_frame(scenario), state, np.zeros(3), matrix)
    fill_nav_covariance(cov, ns, matrix[np.ix_(BATCH, BATCH)])
    return [(topics.NAV_COVARIANCE, cov), (topics.NAV_FIX, fix), (topics.NAV_ODOM, odom)]


class Bench:
    """One node under test on a bus: what is published to it is dealt with at once."""

    def __init__(self, name: str, scenario: Scenario, **own: Any) -> None:
        self.bus, self.scenario = Bus(), scenario
        values = node_values(scenario, {"peers": [name]} | own, node_class(name).sections)
        try:
            self.node = self.bus.add(name, values)
        except BaseException:
            self.bus.close()
            raise
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self.publishers: dict[str, Callable[[Any], None]] = {}
        for topic in {*topics.ALL, *topics_in_use(scenario)}:
            self.bus.hear(topic, partial(self._hear, topic))
        self.bus.tick()

    def _hear(self, topic: Topic, data: bytes) -> None:
        self.heard[topic.name].append(deserialize_message(data, topic.type))

    def wait(self, condition: Callable[[], Any], what: str = "the node's answer") -> None:
        """Let timers come until the condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, f"waited in vain for {what}"
            self.bus.tick()
            time.sleep(1e-3)

    def publish(self, topic: Topic, message: Any) -> None:
        """Publish one message to the node."""
        self.publisher(topic)(message)
        self.bus.run()

    def publisher(self, topic: Topic) -> Callable[[Any], None]:
        """Return what publishes to the node."""
        if topic.name not in self.publishers:
            self.publishers[topic.name] = self.bus.source(topic)
        return self.publishers[topic.name]

    def call(self, name: str, request: Any) -> Any:
        """Return what a service of the node answers."""
        service = services(self.node)[name]
        return service.callback(request, service.srv_type.Response())

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
        for topic, message in nav_messages(
            self.scenario, from_seconds(seconds), latitude, longitude, velocity
        ):
            self.publish(topic, message)

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
        write = accelerations(topic).write_reduced
        message = write(from_seconds(seconds), value, variance, None)
        message.header.frame_id = frame
        self.publish(topic, message)

    def says(self) -> list[tuple[bytes, str, dict[str, str]]]:
        """Return what the node said about itself, now included: level, message, figures."""
        self.node.health.renew()
        items = [item for array in self.heard[topics.DIAGNOSTICS.name] for item in array.status]
        return [
            (item.level, item.message, figures_of(item))
            for item in items
            if not item.name.endswith("batch")
        ]

    def batches(self) -> list[tuple[str, dict[str, str]]]:
        """What the matcher has said of each batch: words and figures."""
        every = (one for array in self.heard["/diagnostics"] for one in array.status)
        return [(one.message, figures_of(one)) for one in every if one.name.endswith("batch")]

    def told(self, words: str) -> tuple[bytes, str, dict[str, str]]:
        """Wait for words in what the node says about itself; return the first of it."""
        self.wait(lambda: any(words in text for _, text, _ in self.says()), words)
        return next(one for one in self.says() if words in one[1])


@contextmanager
def bench(name: str, scenario: Scenario, **own: Any) -> Iterator[Bench]:
    """A bench with one node on it."""
    made = Bench(name, scenario, **own)
    with made.bus:
        yield made


def played(player: Player) -> tuple[Track, list[float]]:
    """Play a feed to its end; return the navigator's track, and its times (s) at which it erred by
    more than three of its sigma and no node said that anything is wrong."""
    wrong: dict[str, bool] = {}
    warned: dict[float, bool] = {}

    def take(data: bytes) -> None:
        for item in deserialize_message(data, topics.DIAGNOSTICS.type).status:
            wrong[item.name] = item.level != OK

    player.bus.hear(topics.DIAGNOSTICS, take)
    with player.bus:
        for ns in sorted(player.recorded.sensors[topics.IMU]):
            player.play(ns / 1e9)
            warned[ns / 1e9] = any(wrong.values())
    track = track_of(player.collector)
    honest = track.error < 3.0 * track.sigma
    return track, [
        t for t, fine in zip(track.time, honest, strict=True) if not (fine or warned[t])
    ]


def run_here(scenario: Scenario, bag: Path | None, run: int = 0, **pace: float) -> float:
    """Run the graph to its end in this process, and return the wall time that it took, s."""
    return run_in_process(Plan(scenario, bag, run=run, **pace), Interrupt())
