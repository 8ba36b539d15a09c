"""Recordings whose topics have other names."""

import json
import re

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float32

from helpers.bag_writing import begin, sample
from helpers.command_line import answer, refusal
from helpers.recordings import rewritten
from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags.metadata import qos_entries
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import wanted_messages
from isogal_ros.bags.remapping import Remapping, given_drivers

FOREIGN = {"/imu/data_raw": "/sbg/imu", "/gravimeter/data_raw": "/mgs6/acceleration"}
RULES = [word for old, new in FOREIGN.items() for word in ("--remap", f"{new}:={old}")]


def test_with_a_scenario_it_is_replayed_as_the_recording_itself_and_viewed(
    recording, scenario, tmp_path
) -> None:
    """As another tool would have made it: other topics, sensors only, no scenario."""

    def kept(topic: str, data: bytes) -> bytes | None:
        sensors = *FOREIGN, "/ground_truth/fix", "/nav/fix"
        return data if topic in sensors else None

    foreign = rewritten(recording, tmp_path / "bag", kept, {}, FOREIGN)
    file = tmp_path / "ship.yaml"
    file.write_text(json.dumps(scenario().model_dump(mode="json")))
    words = "--scenario", file, "--json", "--out", tmp_path / "out", *RULES
    found = json.loads(answer("replay", foreign, *words))
    assert found["fixes"]["replayed"] == 6
    # it has the truth, and the fresh nodes have reduced the readings
    assert (tmp_path / "out" / "report.html").exists()
    answer("view", foreign, "--out", tmp_path / "view.html", "--scenario", file)
    assert "thus which map" not in (tmp_path / "view.html").read_text(encoding="utf-8")
    words = "--remap", "/sbg/imo:=imu/data_raw"
    said = refusal("replay", foreign, "--scenario", file, *words)
    assert "no topic '/sbg/imo' in the recording; did you mean" in said


def test_a_view_without_a_map_and_without_readings(recording, tmp_path) -> None:
    """A recording of another navigator, which says neither; not even how good it is."""

    def place(topic: str, data: bytes) -> bytes | None:
        if topic != "/nav/fix":
            return None
        message = deserialize_message(data, topics.NAV_FIX.type)
        message.position_covariance_type = message.COVARIANCE_TYPE_UNKNOWN
        return serialize_message(message)

    rewritten(recording, tmp_path / "bag", place, {}, {"/nav/fix": "/gps/fix"})
    page = tmp_path / "view.html"
    assert "--remap /TOPIC:=nav/fix" in refusal("view", tmp_path / "bag", "--out", page)
    answer("view", tmp_path / "bag", "--out", page, "--remap", "/gps/fix:=nav/fix")
    text = page.read_text(encoding="utf-8")
    data = json.loads(re.search(r'id="data" type="application/json">(.*?)</script>', text)[1])
    assert len(data["states"]["t"]) > 300
    assert None not in data["states"]["aided_x"]
    assert set(data["states"]["nn"]) == {None}
    assert any("which map" in words for words in data["missing"])


def test_one_of_two_sources(tmp_path) -> None:
    writer = begin(tmp_path / "bag")
    writer.add_topic("/second/imu", "sensor_msgs/msg/Imu", qos_entries([topics.LOSSLESS]), "")
    for i in range(10):
        writer.write("/imu/data_raw", sample(i), i, i)
        writer.write("/second/imu", sample(100 + i), i, i)
    writer.close()
    reader = BagReader(tmp_path / "bag", ["second/imu:=imu/data_raw"])
    assert [one.data for one in reader.messages()] == [sample(100 + i) for i in range(10)]
    assert {one.topic for one in reader.messages()} == {"/imu/data_raw"}


def test_numbers_of_single_precision_are_readings(tmp_path) -> None:
    """They were once left out as no messages, being so short."""
    writer, name = begin(tmp_path / "bag"), "/gravimeter/data_raw"
    writer.add_topic(name, "std_msgs/msg/Float32", qos_entries([topics.LOSSLESS]), "")
    writer.write(name, serialize_message(Float32(data=9.75)), 5, 5)
    writer.close()
    (found,) = wanted_messages(BagReader(tmp_path / "bag"), (topics.GRAVIMETRY,))
    message = deserialize_message(found[1], topics.GRAVIMETRY.type)
    assert (message.accel.accel.linear.z, message.header.stamp.nanosec) == (9.75, 5)


@pytest.mark.parametrize(
    ("parse", "rules", "words"),
    [
        (Remapping.parse, ["/imu"], "must be FROM:=TO"),
        (Remapping.parse, ["/imu:="], "must be FROM:=TO"),
        (Remapping.parse, ["/:=imu/data_raw"], "must be FROM:=TO"),
        (Remapping.parse, ["/imu:=imu/data"], "no topic 'imu/data'; did you mean 'imu/data_raw'"),
        (Remapping.parse, ["/a:=imu/data_raw", "/b:=imu/data_raw"], "comes twice"),
        (given_drivers, ["unit=mGal"], r"must be TOPIC\.KEY=VALUE"),
    ],
)
def test_bad_rules(parse, rules, words) -> None:
    with pytest.raises(InputError, match=words):
        parse(rules)
