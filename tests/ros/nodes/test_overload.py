"""More messages than a node can deal with: what waits is bounded, what is lost is told."""

import time

import numpy as np
import pytest
from rclpy.node import Node
from std_msgs.msg import String

from helpers.domains import claim_domain
from helpers.node_bench import bench
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER, RecorderNode
from isogal_ros.graph.domain import local_context
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.fix_information import FixMessage
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes import nav_queue
from isogal_ros.nodes.health import WARN
from isogal_ros.nodes.spin import make_executor
from isogal_ros.parameters.values import node_values
from ukf_fusion_node import stamp_queue
from ukf_fusion_node.stamp_queue import StampQueue


def test_readings_that_wait_for_a_silent_navigator(scenario, flight, monkeypatch) -> None:
    monkeypatch.setattr(nav_queue, "LONGEST", 8)
    with bench(topics.PMHT_MM, scenario()) as made:
        for scan in range(1, 37):
            flight(made, scan, navigator=False)
        assert made.node.scans.waiting == 8
        assert made.node.health.dropped == {"nav/odom": 28}
        said = "more than 8 readings wait for the navigator"
        assert made.told(said)[0] == WARN


def test_a_burst_of_fixes_is_bounded_and_told(monkeypatch) -> None:
    """Those that wait are kept, those that were used are forgotten first."""
    monkeypatch.setattr(stamp_queue, "KEPT", 10)
    queue = StampQueue(from_seconds(1000.0))
    queue.add(1, FixMessage(None))
    assert [ns for ns, _ in queue.due(10)] == [1]
    for second in range(100, 110):
        queue.add(from_seconds(second), FixMessage(None))
    with pytest.raises(BadMessageError, match="more than 10 wait"):
        queue.add(from_seconds(110.0), FixMessage(None))
    assert len(queue.due(from_seconds(109.0))) == 10
    queue.add(from_seconds(110.0), FixMessage(None))


def test_a_hundred_topics_of_strangers_are_not_recorded(scenario, tmp_path) -> None:
    with claim_domain() as number, local_context(number) as context:
        own = {"bag": str(tmp_path / "bag"), "peers": [RECORDER]}
        values = node_values(scenario(), own, RecorderNode.sections)
        recorder = RecorderNode(RECORDER, values=values, context=context)
        strangers = Node("strangers", context=context, use_global_arguments=False)
        executor = make_executor(context)
        executor.add_node(recorder)
        executor.add_node(strangers)
        many = [strangers.create_publisher(String, f"stranger_{k}", 10) for k in range(100)]
        imu = strangers.create_publisher(topics.IMU.type, topics.IMU.name, topics.LOSSLESS)
        end = time.monotonic() + 20.0
        while not imu.get_subscription_count() and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        for _ in range(20):
            for publisher in many:
                publisher.publish(String(data="x" * 1000))
            imu.publish(topics.IMU.type())
        while recorder.writer.messages < 20 and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        executor.shutdown()
        recorder.close()
        strangers.destroy_node()
    messages = list(BagReader(tmp_path / "bag").messages())
    assert sum(message.topic == "/imu/data_raw" for message in messages) == 20
    assert {message.topic for message in messages} <= {"/imu/data_raw", "/diagnostics"}
    assert np.sum([len(message.data) for message in messages]) < 100_000
