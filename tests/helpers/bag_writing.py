"""Bags with IMU messages only."""

from pathlib import Path

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from isogal_ros import topics
from isogal_ros.bags.metadata import qos_entries
from isogal_ros.bags.writer import BagWriter
from isogal_ros.messages.stamps import set_stamp

IMU_HASH = "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"


def sample(i: int) -> bytes:
    """The serialised message of second i."""
    message = Imu()
    set_stamp(message.header.stamp, i * 10**9)
    message.linear_acceleration.x = i * 0.1
    return serialize_message(message)


def begin(folder: Path) -> BagWriter:
    """A writer of a bag that has a scenario and knows the topic."""
    writer = BagWriter(folder, {"scenario": "seed: 3\n", "run": "2"})
    qos = qos_entries([topics.LOSSLESS])
    writer.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu", qos, IMU_HASH)
    return writer


def write(folder: Path, count: int = 500) -> list[bytes]:
    """Write a bag; return its messages."""
    writer = begin(folder)
    messages = [sample(i) for i in range(count)]
    for i, data in enumerate(messages):
        writer.write("/imu/data_raw", data, i * 10**9, 10**18 + i)
    writer.close()
    return messages
