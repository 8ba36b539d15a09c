"""``metadata.yaml`` as rosbag2 writes it."""

import yaml
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy

from helpers.bag_writing import write
from isogal_ros.bags.metadata import qos_entries


def test_metadata_as_rosbag2_writes_it(tmp_path) -> None:
    write(tmp_path / "bag")
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    assert "&id" not in text
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert information["version"] == 9
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == ["bag_0.mcap"]
    assert information["message_count"] == 500
    assert information["starting_time"] == {"nanoseconds_since_epoch": 0}
    assert information["duration"] == {"nanoseconds": 499 * 10**9}
    (entry,) = information["topics_with_message_count"]
    assert entry["message_count"] == 500
    topic = entry["topic_metadata"]
    assert (topic["name"], topic["type"], topic["serialization_format"]) == (
        "/imu/data_raw",
        "sensor_msgs/msg/Imu",
        "cdr",
    )
    qos = topic["offered_qos_profiles"][0]
    assert (qos["history"], qos["reliability"]) == ("keep_all", "reliable")
    assert qos["deadline"] == {"sec": 9223372036, "nsec": 854775807}


def test_quality_of_service_in_words() -> None:
    profile = QoSProfile(
        depth=3, reliability=ReliabilityPolicy.BEST_EFFORT, deadline=Duration(seconds=1.5)
    )
    (entry,) = qos_entries([profile])
    assert (entry["history"], entry["depth"], entry["reliability"]) == (
        "keep_last",
        3,
        "best_effort",
    )
    assert entry["deadline"] == {"sec": 1, "nsec": 500_000_000}
