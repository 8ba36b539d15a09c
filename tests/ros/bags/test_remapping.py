"""Recordings whose topics have other names."""

import json
import re

import pytest
from rclpy.serialization import deserialize_message, serialize_message

from helpers.command_line import answer, refusal
from helpers.recordings import rewritten
from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags.remapping import Remapping, given_drivers

FOREIGN = {"/imu/data_raw": "/sbg/imu", "/gravimeter/data_raw": "/mgs6/acceleration"}
RULES = [word for old, new in FOREIGN.items() for word in ("--remap", f"{new}:={old}")]


def test_with_a_scenario_it_is_replayed_as_the_recording_itself_and_viewed(
    recording, scenario, tmp_path
) -> None:
    """As another tool would have made it: other topics, sensors only, no scenario."""

    def kept(topic: str, data: bytes) -> bytes | None:
        return None if topic.startswith("/pmht_mm") else data

    foreign = rewritten(recording, tmp_path / "bag", kept, {}, FOREIGN)
    file = tmp_path / "ship.yaml"
    file.write_text(json.dumps(scenario().model_dump(mode="json")))
    found = json.loads(answer("replay", foreign, "--scenario", file, "--json", *RULES))
    assert found["fixes"]["replayed"] == 6
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
