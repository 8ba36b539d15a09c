"""Time never turns back: neither by old samples, nor where samples are found untrue."""

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from helpers.node_bench import bench, stamps
from isogal_ros import topics
from isogal_ros.graph.bus import Bus
from isogal_ros.messages.frames import BASE
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.parameters.values import node_values
from ukf_fusion_node.node import UkfFusionNode

LEVEL = np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0])
NOISE = LEVEL + np.random.default_rng(5).normal(0.0, 1e-4, (200, 6))
OUTPUTS = (topics.NAV_ODOM, topics.NAV_FIX, topics.NAV_PATH)


class Played:
    """A filter on a bus, and the stamps (s) of what it publishes."""

    def __init__(self, scenario) -> None:
        self.bus = Bus()
        values = node_values(scenario, {"peers": [topics.UKF_FUSION]}, UkfFusionNode.sections)
        self.node = self.bus.add(topics.UKF_FUSION, values)
        self.bus.tick()
        self.stamps: dict[str, list[float]] = defaultdict(list)
        self.last = topics.NAV_ODOM.type()
        for topic in OUTPUTS:
            self.bus.hear(topic, lambda data, topic=topic: self._take(topic, data))

    def _take(self, topic, data: bytes) -> None:
        message = deserialize_message(data, topic.type)
        self.stamps[topic.name].append(to_seconds(to_ns(message.header.stamp)))
        if topic is topics.NAV_ODOM:
            self.last = message

    def imu(self, seconds: float, values) -> None:
        message = topics.IMU.type()
        message.header.frame_id = BASE
        fill_imu(message, from_seconds(seconds), np.array(values[:3]), np.array(values[3:]))
        self.bus.send(topics.IMU.name, message)
        self.bus.run()

    def no_fix(self, seconds: float) -> None:
        message = topics.FIX.type()
        message.header.frame_id = BASE
        fill_fix(message, from_seconds(seconds), 0.0, 0.0, 0.0, None, -1)
        self.bus.send(topics.FIX.name, message)
        self.bus.run()

    def assert_in_order(self) -> None:
        for topic in OUTPUTS:
            assert self.stamps[topic.name] == sorted(self.stamps[topic.name]), topic.name


@pytest.fixture
def played(scenario) -> Iterator[Played]:
    made = Played(scenario())
    for k in range(1, 101):
        made.imu(k, NOISE[k])
    assert made.stamps["nav/odom"][-1] == 100.0
    with made.bus:
        yield made


def place(message) -> np.ndarray:
    point = message.pose.pose.position
    return np.array([point.x, point.y, point.z])


@pytest.mark.parametrize("what", ["the same", "as they were", "two by turns"])
def test_old_samples_change_nothing(scenario, played, what) -> None:
    """A block of equal ones was once taken for a stuck sensor, and the newest true samples were
    forgotten with it; so was one for each that differs from its neighbours."""
    alone = Played(scenario())
    with alone.bus:
        for k in range(1, 111):
            alone.imu(k, NOISE[k])
    other = NOISE[0] + [0.5, 0, 0, 0, 0, 0]
    for k in range(300):
        old = {"the same": NOISE[0], "as they were": NOISE[90 + k % 5]}
        played.imu(95.0 + 1e-3 * k, old.get(what, (NOISE[0], other)[k % 2]))
        if k == 150:
            played.no_fix(90.0)
    for k in range(101, 111):
        played.imu(k - 5.0, other)
        played.imu(k, NOISE[k])
    played.assert_in_order()
    assert played.stamps["nav/odom"][-12:] == [100.0, 100.0, *range(101, 111)]
    assert place(played.last) == pytest.approx(place(alone.last), abs=0)
    assert played.node.health.dropped == {"imu/data_raw": 310}


def test_what_was_published_of_untrue_samples_is_not_published_again(played) -> None:
    """A sensor that is stuck is found out late: the samples since are forgotten. A fix that comes
    then is answered at the stamp that was reached, with what the state has become by then."""
    for k in range(101, 107):
        played.imu(k, NOISE[100])
    assert played.node.health.dropped["imu/data_raw"] == 2
    reached = played.stamps["nav/odom"][-1]
    assert 101.0 < reached < 110.0
    played.no_fix(reached - 20.0)
    assert played.stamps["nav/odom"][-2:] == [reached, reached]
    moved = place(played.last)
    played.imu(reached, NOISE[106])  # too old, if later than the newest true one
    assert "not later" in played.node.health.why["imu/data_raw"]
    played.imu(107.0, NOISE[107])
    played.assert_in_order()
    twist = played.last.twist.twist.linear
    speed = np.linalg.norm(place(played.last) - moved) / (107.0 - reached)
    assert speed == pytest.approx(np.linalg.norm([twist.x, twist.y]), abs=0.2)


def test_after_a_reset_time_may_begin_anew(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in (1, 2, 3, 1):
            made.imu(k)
        assert made.call("reset", Trigger.Request()).success
        made.imu(1)
        assert stamps(made, topics.NAV_ODOM) == [0, 1, 2, 3, 0, 1]
