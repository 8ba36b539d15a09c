"""Publishers that are best effort are heard, those that are reliable without loss."""

import time

import pytest
import rclpy
from rclpy.qos import qos_profile_sensor_data

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.graph.domain import local_context
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.spin import make_executor
from isogal_ros.parameters.values import node_values

PATIENCE = 20.0


class Hearer(GraphNode):
    """Keeps the stamps of IMU samples."""

    sections = ("seed",)

    def setup(self) -> None:
        self.heard: list[int] = []
        self.listening = self.listen(topics.IMU, self._take)

    def _take(self, message) -> None:
        self.heard.append(message.header.stamp.sec)


@pytest.fixture
def graph(domain):
    """A node that listens, a node to publish from, and a function that spins until something is
    so."""
    with local_context(domain) as context:
        values = node_values(Scenario(), {"peers": ["hearer"]}, Hearer.sections)
        hearer = Hearer("hearer", values=values, context=context)
        driver = rclpy.create_node("driver", context=context)
        executor = make_executor(context)
        executor.add_node(hearer)
        executor.add_node(driver)

        def until(so) -> bool:
            end = time.monotonic() + PATIENCE
            while not so() and time.monotonic() < end:
                executor.spin_once(timeout_sec=0.02)
            return so()

        yield hearer, driver, until
        executor.shutdown()
        for node in (hearer, driver):
            node.destroy_node()


def sample(second: int):
    message = topics.IMU.type()
    message.header.stamp.sec = second
    return message


def test_both_kinds_of_publishers_are_heard(graph) -> None:
    hearer, driver, until = graph
    reliable = driver.create_publisher(topics.IMU.type, "imu/data_raw", topics.LOSSLESS)
    assert until(lambda: hearer.listening.get_publisher_count() == 1)
    reliable.publish(sample(1))
    assert until(lambda: hearer.heard == [1])
    careless = driver.create_publisher(topics.IMU.type, "imu/data_raw", qos_profile_sensor_data)
    assert until(lambda: hearer.listening.get_publisher_count() == 2)
    reliable.publish(sample(2))
    assert until(lambda: hearer.heard == [1, 2])
    assert until(lambda: careless.get_subscription_count() == 1)  # or the sample is lost
    careless.publish(sample(3))
    assert until(lambda: hearer.heard == [1, 2, 3])
    assert hearer.listening.topic_name == "/imu/data_raw"
    hearer.listening.end()
    assert len(list(hearer.subscriptions)) == 0
