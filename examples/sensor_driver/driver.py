"""A driver: what an inertial measurement unit and a gravimeter say becomes messages.

    python examples/sensor_driver/driver.py --ros-args -p folder:=out/driver -p speed:=60.0

The instruments are two files here, played at `speed` seconds per second. For real ones replace
`imu_samples` and `gravimeter_readings` by what reads their ports; the rest stays."""

import csv
import heapq
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import AccelWithCovarianceStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu

NOTHING_LOST = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
UNKNOWN = 0.0
"""Variance: the receiver takes that of its own parameters."""
LISTENERS = {"imu/data_raw": "ukf_fusion_node", "gravimeter/data_raw": "gravimeter_node"}
"""Nodes that have to listen before the first message: what comes earlier they do not hear."""


class Driver(Node):
    """Publishes the samples of both instruments in the order of their stamps."""

    def __init__(self) -> None:
        super().__init__("driver")
        folder = Path(self.declare_parameter("folder", "out/driver").value)
        number = ParameterDescriptor(dynamic_typing=True)  # 60 is as good as 60.0
        self.speed = float(self.declare_parameter("speed", 1.0, number).value)
        self.outputs = {
            "imu/data_raw": self.create_publisher(Imu, "imu/data_raw", NOTHING_LOST),
            "gravimeter/data_raw": self.create_publisher(
                AccelWithCovarianceStamped, "gravimeter/data_raw", NOTHING_LOST
            ),
        }
        self.samples = heapq.merge(
            imu_samples(folder / "imu.csv"),
            gravimeter_readings(folder / "gravimeter.csv"),
            key=lambda sample: sample[0],
        )

    def run(self) -> None:
        """Wait for the listeners, publish everything, and wait until it has arrived."""
        while not all(self.is_heard(*item) for item in LISTENERS.items()):
            rclpy.spin_once(self, timeout_sec=0.1)
        self.get_logger().info("begun")
        begun, first = time.monotonic(), None
        for utc, topic, message in self.samples:
            first = utc if first is None else first
            wait = (utc - first) / self.speed - (time.monotonic() - begun)
            if wait > 0.0:
                time.sleep(wait)
            self.outputs[topic].publish(message)
        for publisher in self.outputs.values():
            publisher.wait_for_all_acked(Duration(seconds=10.0))
        self.get_logger().info("ended")

    def is_heard(self, topic: str, node: str) -> bool:
        """Say whether a node listens to a topic, and all who do (a recorder may) are connected."""
        known = self.get_subscriptions_info_by_topic(topic)
        connected = self.outputs[topic].get_subscription_count()
        return connected >= len(known) and node in {listener.node_name for listener in known}


def imu_samples(path: Path) -> Iterator[tuple[float, str, Imu]]:
    """Yield (stamp, topic, message) of the inertial unit, which says velocity and angle increments
    since its sample before, x forward, y right, z down.

    A message holds the means over the interval that ends at its stamp, x forward, y left, z up."""
    before = None
    for utc, *increments in rows_of(path):
        interval = 1.0 if before is None else utc - before
        dv_x, dv_y, dv_z, da_x, da_y, da_z = (value / interval for value in increments)
        message = Imu()
        stamp(message.header, utc, "base_link")
        force, rate = message.linear_acceleration, message.angular_velocity
        force.x, force.y, force.z = dv_x, -dv_y, -dv_z
        rate.x, rate.y, rate.z = da_x, -da_y, -da_z
        message.orientation_covariance[0] = -1.0  # it has none
        before = utc
        yield utc, "imu/data_raw", message


def gravimeter_readings(path: Path) -> Iterator[tuple[float, str, AccelWithCovarianceStamped]]:
    """Yield (stamp, topic, message) of the gravimeter, which says mGal; a message has m/s², on the
    axis z, which points up on its level platform."""
    for utc, gravity_mgal in rows_of(path):
        message = AccelWithCovarianceStamped()
        stamp(message.header, utc, "gravimeter_link")
        message.accel.accel.linear.z = 1e-5 * gravity_mgal
        message.accel.covariance[14] = UNKNOWN
        yield utc, "gravimeter/data_raw", message


def rows_of(path: Path) -> Iterator[list[float]]:
    """Yield the numbers of each line below the first."""
    with path.open(newline="", encoding="utf-8") as stream:
        lines = csv.reader(stream)
        next(lines)
        for line in lines:
            yield [float(word) for word in line]


def stamp(header: Any, utc: float, frame: str) -> None:
    """Write the time at which a sample was true, and its frame."""
    seconds, milliseconds = divmod(round(utc * 1000.0), 1000)
    header.stamp.sec, header.stamp.nanosec = seconds, milliseconds * 1_000_000
    header.frame_id = frame


def main() -> None:
    """Run the driver until its files end."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C is Python's
    driver = Driver()
    try:
        driver.run()
    except KeyboardInterrupt:
        pass
    finally:
        driver.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
