"""Recordings: laid out as ros2 bag does, readable by others, and up to the cut when the recorder
is killed."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.bags.writer import BagWriter, prepare_folder, qos_text, schema_text
from isogal_ros.messages.stamps import set_stamp

IMU_HASH = "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"


def sample(i: int) -> bytes:
    message = Imu()
    set_stamp(message.header.stamp, i * 10**9)
    message.linear_acceleration.x = i * 0.1
    return serialize_message(message)


def write(folder: Path, count: int = 500, close: bool = True, flush: int = 0) -> list[bytes]:
    writer = BagWriter(folder, {"scenario": "seed: 3\n", "run": "2"})
    writer.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu", qos_text([topics.LOSSLESS]), IMU_HASH)
    messages = [sample(i) for i in range(count)]
    for i, data in enumerate(messages):
        writer.write("/imu/data_raw", data, i * 10**9, 10**18 + i)
        if flush and i % flush == flush - 1:
            writer._writer.flush()
    if close:
        writer.close()
    else:
        writer._stream.close()
    return messages


def test_what_is_written_is_read(tmp_path) -> None:
    messages = write(tmp_path / "bag")
    reader = BagReader(tmp_path / "bag")
    assert reader.scenario().seed == 3
    assert reader.texts["run"] == "2"
    found = list(reader.messages())
    assert [item.data for item in found] == messages
    assert [item.log_ns for item in found] == [i * 10**9 for i in range(500)]
    assert {item.topic for item in found} == {"/imu/data_raw"}
    assert reader.cut is None
    assert reader.types == {"/imu/data_raw": "sensor_msgs/msg/Imu"}


def test_others_read_it(tmp_path) -> None:
    from rosbags.highlevel import AnyReader

    write(tmp_path / "bag")
    with AnyReader([tmp_path / "bag"]) as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype, connection.msgcount) == (
            "/imu/data_raw",
            "sensor_msgs/msg/Imu",
            500,
        )
        assert connection.ext.offered_qos_profiles[0].reliability.name == "RELIABLE"
        values = [
            reader.deserialize(data, kind.msgtype).linear_acceleration.x
            for kind, _, data in reader.messages()
        ]
    assert values == [i * 0.1 for i in range(500)]


def test_mcap_decodes_it_by_its_own_schemas(tmp_path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    write(tmp_path / "bag", 20)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        found = list(reader.iter_decoded_messages())
        metadata = {item.name: item.metadata for item in reader.iter_metadata()}
    assert [message.linear_acceleration.x for *_, message in found] == [i * 0.1 for i in range(20)]
    schema, channel, message, _ = found[3]
    assert (schema.name, schema.encoding, channel.message_encoding) == (
        "sensor_msgs/msg/Imu",
        "ros2msg",
        "cdr",
    )
    assert channel.metadata["topic_type_hash"] == IMU_HASH
    assert yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]["durability"] == "volatile"
    assert (message.log_time, message.publish_time) == (3 * 10**9, 10**18 + 3)
    assert yaml.safe_load(metadata["rosbag2"]["serialized_metadata"])["message_count"] == 20


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
    from rclpy.duration import Duration

    profile = QoSProfile(
        depth=3, reliability=ReliabilityPolicy.BEST_EFFORT, deadline=Duration(seconds=1.5)
    )
    (entry,) = qos_text([profile])
    assert (entry["history"], entry["depth"], entry["reliability"]) == (
        "keep_last",
        3,
        "best_effort",
    )
    assert entry["deadline"] == {"sec": 1, "nsec": 500_000_000}


def test_schema_holds_all_that_a_message_contains(monkeypatch) -> None:
    for environment in (None, "/nowhere"):  # packages from wheels are not in the ament index
        schema_text.cache_clear()
        if environment is None:
            monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
        else:
            monkeypatch.setenv("AMENT_PREFIX_PATH", environment)
        text = schema_text("nav_msgs/msg/Odometry")
        for name in (
            "std_msgs/Header",
            "geometry_msgs/PoseWithCovariance",
            "geometry_msgs/Quaternion",
            "builtin_interfaces/Time",
        ):
            assert text.count(f"MSG: {name}\n") == 1
    for topic in topics.ALL:
        assert schema_text(topics.type_name(topic.type))


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.77, 0.95, 0.999])
def test_a_file_cut_anywhere_is_read_up_to_the_cut(tmp_path, share) -> None:
    messages = write(tmp_path / "bag", 4000)
    path = tmp_path / "bag" / "bag_0.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    reader = BagReader(tmp_path / "bag")
    found = [item.data for item in reader.messages()]
    assert found == messages[: len(found)]
    assert len(found) >= share * 4000 - 800  # a chunk at most, and what lies behind the messages
    assert "ends early" in str(reader.cut)
    assert reader.scenario().seed == 3


def test_damage_in_the_middle_is_noticed(tmp_path) -> None:
    messages = write(tmp_path / "bag", 4000)
    path = tmp_path / "bag" / "bag_0.mcap"
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(64)
    path.write_bytes(data)
    reader = BagReader(tmp_path / "bag")
    found = [item.data for item in reader.messages()]
    assert found == messages[: len(found)]
    assert 0 < len(found) < 4000
    assert reader.cut


def test_a_killed_writer_leaves_what_it_has_flushed(tmp_path) -> None:
    script = (
        "import sys, time; sys.path.insert(0, sys.argv[2]); from pathlib import Path; from"
        " test_bag import write;write(Path(sys.argv[1]), 1000, close=False, flush=100);"
        " print('ready', flush=True); time.sleep(60)"
    )
    folder = tmp_path / "bag"
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(folder), str(Path(__file__).parent)],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    reader = BagReader(folder)
    assert len(list(reader.messages())) == 1000
    assert reader.cut
    assert (
        yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"][
            "version"
        ]
        == 9
    )


def test_bad_bags(tmp_path) -> None:
    cases = {
        tmp_path / "none": "no such bag",
        tmp_path: "no MCAP file",
        Path(__file__): "not an MCAP file by its name",
    }
    for path, words in cases.items():
        with pytest.raises(InputError, match=words):
            BagReader(path)
    (tmp_path / "x.db3").write_bytes(b"")
    with pytest.raises(InputError, match="ros2 bag convert"):
        BagReader(tmp_path)
    for content in (b"", b"123", b"hello, this is no MCAP file at all"):
        (tmp_path / "y.mcap").write_bytes(content)
        with pytest.raises(InputError, match="not an MCAP file"):
            BagReader(tmp_path / "y.mcap")
    (tmp_path / "z.mcap").write_bytes(b"")
    with pytest.raises(InputError, match="2 MCAP files"):
        BagReader(tmp_path)


def test_folders(tmp_path) -> None:
    prepare_folder(tmp_path / "a" / "b", replace=False)
    assert (tmp_path / "a" / "b").is_dir()
    write(tmp_path / "bag", 5)
    with pytest.raises(InputError, match="there is a bag already"):
        prepare_folder(tmp_path / "bag", replace=False)
    prepare_folder(tmp_path / "bag", replace=True)
    assert not list((tmp_path / "bag").iterdir())
    (tmp_path / "bag" / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match=r"something else than a bag \(thesis.txt\)"):
        prepare_folder(tmp_path / "bag", replace=True)
    assert (tmp_path / "bag" / "thesis.txt").exists()
    with pytest.raises(InputError, match="is a file"):
        prepare_folder(tmp_path / "bag" / "thesis.txt", replace=True)


def test_topics_in_namespaces() -> None:
    assert topic_of("/nav/fix", "nav/fix")
    assert topic_of("/ship/nav/fix", "nav/fix")
    assert topic_of("/diagnostics", "/diagnostics")
    assert not topic_of("/nav/fixed", "nav/fix")
    assert not topic_of("/old_nav/fix", "nav/fix")
