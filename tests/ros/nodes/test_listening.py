"""Publishers that are best effort are heard, those that are reliable without loss; of several
publishers of a sensor's topic one is used.

Each test has topics of its own: nodes that have been destroyed can stay for as long as their
process, and these tests count who is there."""

import time
from dataclasses import replace
from itertools import count

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Float64

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.graph.domain import local_context
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import WARN
from isogal_ros.nodes.listening import Listening
from isogal_ros.nodes.spin import make_executor
from isogal_ros.parameters.values import node_values

PATIENCE = 20.0
NUMBER = count()


class Hearer(GraphNode):
    """Keeps the stamps of IMU samples, serialised or not, and of poses."""

    sections = ("seed",)

    def setup(self) -> None:
        self.heard: list[int] = []
        self.poses: list[int] = []
        self.said: list[str] = []
        number = next(NUMBER)
        self.t_imu, self.t_pose = (
            replace(topic, name=f"listening_{number}/{topic.name}")
            for topic in (topics.IMU, topics.INITIAL_POSE)
        )
        self.imu = self.listen(self.t_imu, lambda message: self.heard.append(second(message)))
        self.pose = self.listen(self.t_pose, lambda message: self.poses.append(second(message)))

    def log(self, level: bytes, text: str) -> None:
        if level == WARN:
            self.said.append(text)


class Graph:
    """A node that listens, and nodes to publish from. These are not on the executor, which keeps
    what it has had: where a test fails, others would hear their publishers."""

    def __init__(self, context, executor) -> None:
        values = node_values(Scenario(), {"peers": ["hearer"]}, Hearer.sections)
        self.hearer = Hearer("hearer", values=values, context=context)
        self.executor, self.context = executor, context
        self.nodes = [self.hearer]
        executor.add_node(self.hearer)

    def publisher(self, name: str, topic=None, qos=topics.LOSSLESS):
        """A publisher of a new node, of IMU samples unless a topic is given."""
        topic = topic or self.hearer.t_imu
        self.nodes.append(rclpy.create_node(name, context=self.context))
        return self.nodes[-1].create_publisher(topic.type, topic.name, qos)

    def driver_in_use(self):
        """A publisher of IMU samples whose first has been heard."""
        made = self.publisher("driver")
        assert self.connected(made, self.hearer.imu, 1)
        made.publish(sample(1))
        assert self.until(lambda: self.hearer.heard == [1])
        return made

    def connected(self, publisher, listening: Listening, count: int) -> bool:
        """Spin until either side knows of the other: what is published before is lost."""
        return self.until(
            lambda: (
                publisher.get_subscription_count() == 1
                and listening.get_publisher_count() == count
            )
        )

    def until(self, so) -> bool:
        """Spin until something is so."""
        end = time.monotonic() + PATIENCE
        while not so() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)
        return so()

    def close(self) -> None:
        self.executor.remove_node(self.hearer)
        for node in self.nodes:
            node.destroy_node()
        self.executor.shutdown()


@pytest.fixture
def graph(domain, request):
    with local_context(domain) as context:
        made = Graph(context, getattr(request, "param", make_executor)(context))
        yield made
        made.close()


def second(message) -> int:
    return message.header.stamp.sec


def sample(number: int, topic=topics.IMU):
    message = topic.type()
    message.header.stamp.sec = number
    return message


def test_a_publisher_of_another_type_is_heard(graph, domain) -> None:
    """A gravimeter's driver that publishes numbers, best effort: they are taken as what the graph
    has."""
    hearer, topic = graph.hearer, replace(topics.GRAVIMETRY, name=f"listening_{next(NUMBER)}/g")
    heard: list[float] = []
    listening = hearer.listen(topic, lambda message: heard.append(message.accel.accel.linear.z))
    with local_context(domain) as elsewhere:  # a process has one type of a topic
        node = rclpy.create_node("driver", context=elsewhere)
        driver = node.create_publisher(Float64, topic.name, qos_profile_sensor_data)
        assert graph.connected(driver, listening, 1)
        driver.publish(Float64(data=9.8))
        assert graph.until(lambda: heard == [9.8])
        node.destroy_node()


EXECUTORS = make_executor, lambda context: SingleThreadedExecutor(context=context)
EITHER = pytest.mark.parametrize("graph", EXECUTORS, indirect=True, ids=["events", "plain"])


@EITHER
def test_publishers_are_kept_apart(graph) -> None:
    """Samples of two drivers were once used by turns; the second one's numbers are all later."""
    hearer = graph.hearer
    first, second = graph.publisher("driver"), graph.publisher("simulator")
    assert graph.connected(first, hearer.imu, 2)
    assert graph.connected(second, hearer.imu, 2)
    for number in range(20):
        first.publish(sample(number))
        second.publish(sample(100 + number))
    dropped = hearer.health.dropped
    assert graph.until(lambda: len(hearer.heard) + dropped.get(hearer.t_imu.name, 0) == 40)
    assert hearer.heard == list(range(20))
    assert dropped == {hearer.t_imu.name: 20}
    assert hearer.health.why[hearer.t_imu.name] == (
        "of a second publisher, /simulator: /driver is used"
    )
    assert sum("dropped: of a second publisher" in text for text in hearer.said) == 1
    graph.nodes[1].destroy_node()
    assert graph.until(lambda: hearer.imu.get_publisher_count() == 1)
    second.publish(sample(200))
    second.publish(sample(201))
    assert graph.until(lambda: hearer.heard[20:] == [200, 201])


def test_a_successor_of_the_same_name_takes_over_at_once(graph) -> None:
    """Of a process that was killed the middleware notices only after 20 s that it is gone."""
    hearer, first = graph.hearer, graph.driver_in_use()
    second = graph.publisher("driver")
    assert graph.connected(second, hearer.imu, 2)
    for number in (2, 3):
        second.publish(sample(number))
    assert graph.until(lambda: hearer.heard == [1, 2, 3])
    assert hearer.health.dropped == {}
    first.publish(sample(4))  # it was there all the time
    second.publish(sample(5))
    assert graph.until(lambda: hearer.heard == [1, 2, 3, 5])
    assert graph.until(lambda: hearer.health.dropped == {hearer.t_imu.name: 1})
