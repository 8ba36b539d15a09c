"""Nodes whose sensors and frames are not as the graph has them."""

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64

from helpers.bag_writing import begin
from helpers.node_bench import bench
from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import wanted_messages
from isogal_ros.messages.gravimeter import gravity
from isogal_ros.nodes.health import WARN

PLACE = (-0.637, 2.5656)
OUTSIDE = {"map_frame": "world", "tf_prefix": "ship"}


def reduced(scenario, send, **own) -> float:
    """What gravimeter_node makes of a reading that `send` publishes."""
    with bench(topics.GRAVIMETER, scenario(), simulate=False, **own) as made:
        send(made)
        made.nav(10.0, *PLACE, (12.0, 15.0))
        made.wait(lambda: made.heard["gravimeter/gravity"])
        return made.heard["gravimeter/gravity"][0].accel.accel.linear.z


def test_a_gravimeter_in_mgal_and_of_another_frame(scenario) -> None:
    def as_the_driver_does(made) -> None:
        made.reading(10.0, 979_520.0, variance=1.0, frame="mgs6", topic=topics.GRAVIMETRY)

    entry = "{gravimeter/data_raw: {unit: mGal, frame: mgs6}}"
    plain = reduced(scenario, lambda made: made.reading(10.0, 9.7952, topic=topics.GRAVIMETRY))
    assert reduced(scenario, as_the_driver_does, drivers=entry) == pytest.approx(plain, abs=1e-12)


def test_a_mounting_that_is_not_said_is_not_guessed(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario(), drivers="{imu/data_raw: {frame: imu}}") as made:
        made.imu(1.0, frame="camera")
        level, text, _ = made.told("frame_id must be 'base_link', is 'camera'")
    assert level == WARN
    assert "imu_frame" in text


def test_frames_have_other_names_outside(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario(), **OUTSIDE) as made:
        made.imu(1.0, frame="ship/base_link")
        made.imu(2.0, frame="base_link")  # a driver that knows no prefix
        odometry, path = made.heard["nav/odom"][-1], made.heard["nav/path"][-1]
        assert odometry.header.stamp.sec == 2
        assert made.heard["nav/fix"][-1].header.frame_id == "ship/base_link"
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("ship/world", "ship/base_link")
    assert {one.header.frame_id for one in (path, *path.poses)} == {"ship/world"}


def test_bad_drivers_are_refused_before_the_node_begins(scenario) -> None:
    with (
        pytest.raises(InputError, match=r"drivers\.imu/data_raw\.unit: must be empty, not 'g'"),
        bench(topics.UKF_FUSION, scenario(), drivers="{imu/data_raw: {unit: g}}"),
    ):
        pass


def test_numbers_of_a_recording_have_the_time_of_their_recording(scenario, tmp_path) -> None:
    writer = begin(tmp_path / "bag")
    writer.add_topic("/gravi", "std_msgs/msg/Float64", [], "")
    for second in (10, 20):
        data = serialize_message(Float64(data=979_520.0))
        writer.write("/gravi", data, second * 10**9, second * 10**9)
    writer.close()
    said = ["/gravi:=gravimeter/data_raw"], ["gravimeter/data_raw.unit=mGal"]
    reader = BagReader.foreign(tmp_path / "bag", *said)
    found = [data for _, data in wanted_messages(reader, [topics.GRAVIMETRY])]
    messages = [deserialize_message(data, topics.GRAVIMETRY.type) for data in found]
    assert [one.header.stamp.sec for one in messages] == [10, 20]
    assert gravity(scenario()).read_raw(messages[0])[0] == pytest.approx(9.7952)


def test_a_driver_option_needs_a_topic_and_a_key(tmp_path) -> None:
    with pytest.raises(InputError, match=r"must be TOPIC\.KEY=VALUE"):
        BagReader.foreign(begin(tmp_path / "bag").path, None, ["unit=mGal"])
