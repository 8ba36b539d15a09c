"""A replay that has shown nothing fails, and says why; none claims what it has not done."""

import json
from pathlib import Path

import pytest

from helpers.command_line import call
from helpers.recordings import in_frame, rewritten
from isogal_ros import topics

FRAMES = {
    "/imu/data_raw": (topics.IMU, "imu_link"),
    "/gravimeter/data_raw": (topics.GRAVIMETRY, "grav"),
    "/gravimeter/gravity": (topics.GRAVITY, "grav"),
    "/gravimeter/disturbance": (topics.DISTURBANCE, "grav"),
}
OF_ISOGAL = ("/imu/data_raw", "/gravimeter/data_raw", "/gravimeter/disturbance")
"""What a vehicle's own recording has of the graph's topics."""


@pytest.fixture(scope="module")
def framed(recording, tmp_path_factory):
    """Make copies of the recording whose topics that begin with a prefix are in other frames."""

    def make(prefix: str) -> Path:
        def change(topic: str, data: bytes) -> bytes:
            renamed = topic in FRAMES and topic.startswith(prefix)
            return in_frame(FRAMES[topic][0], data, FRAMES[topic][1]) if renamed else data

        return rewritten(recording, tmp_path_factory.mktemp("framed") / "bag", change)

    return make


@pytest.fixture(scope="module")
def sensors_only(recording, tmp_path_factory) -> Path:
    """The recording without what the nodes answered, and without the truth."""
    return rewritten(
        recording,
        tmp_path_factory.mktemp("sensors") / "bag",
        lambda topic, data: data if topic in OF_ISOGAL else None,
    )


Answer = tuple[int, str, list[str]]
"""Exit status, standard output, and the command's own lines on standard error."""


def replayed(*words: object) -> Answer:
    status, out, err = call("replay", *words)
    assert "Traceback" not in err
    return status, out, [line for line in err.splitlines() if line[:8] == "isogal: "]


def test_other_frames_fail_and_are_named(framed, tmp_path) -> None:
    """It once ended with "disagreements: 0", exit status 0 and the path of a report that was not
    there."""
    status, out, lines = replayed(framed("/"), "--out", tmp_path / "out")
    assert status == 1
    imu, gravity, fixes = lines
    assert "imu/data_raw: none of 360 messages was used" in imu
    assert "frame_id must be 'base_link', is 'imu_link' (parameter imu_frame)" in imu
    assert "gravimeter/data_raw: none of 36 messages was used" in gravity
    assert "frame_id must be 'gravimeter_link', is 'grav'" in gravity
    assert "by --driver TOPIC.frame=NAME" in gravity
    assert "no fix: no batch ended" in fixes
    assert "Largest difference" not in out
    assert "No report" in out
    assert not (tmp_path / "out" / "report.html").exists()


def test_readings_of_another_frame_fail(framed) -> None:
    """They were waited for in vain."""
    status, _, lines = replayed(framed("/gravimeter"))
    assert status == 1
    assert "gravimeter/data_raw: none of 36 messages was used: 36 dropped: frame_id" in lines[0]


def test_the_parameter_that_is_named_mends_it(framed) -> None:
    words = "--parameter", "imu_frame=imu_link", "--tolerance", 1e-3
    status, out, lines = replayed(framed("/imu"), *words)
    assert status == 0, lines
    assert "disagreements: 0" in out


def test_nothing_is_compared_without_recorded_fixes(sensors_only, tmp_path) -> None:
    """It once said "disagreements" of each fix, and claimed a report."""
    status, out, lines = replayed(sensors_only, "--out", tmp_path / "out")
    assert status == 0, lines
    assert "0 recorded, 6 replayed" in out
    assert "Not compared: there are no fixes in the recording (pmht_mm/fix)" in out
    assert "isagreements" not in out
    assert "No report: it needs a whole replay, and ground_truth/fix" in out
    assert "report.html" not in out
    status, out, lines = replayed(sensors_only, "--tolerance", "1", "--json")
    document = json.loads(out)
    assert document["fixes"] == {"recorded": 0, "replayed": 6, "common": 0}
    assert document["disagreements"] is document["largest_difference_m"] is None
    assert status == 1
    assert "there are no fixes in the recording (pmht_mm/fix) to compare with" in lines[0]


def test_a_sensor_that_the_recording_lacks_is_named_with_its_key(recording) -> None:
    change = "height={source: barometer}"
    status, _, (line,) = replayed(recording, "--set", change)
    assert status == 2
    assert "no messages on barometer/data_raw" in line
    assert "--remap /TOPIC:=barometer/data_raw" in line


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("imu_frme=x", "--parameter imu_frme: no such parameter; did you mean"),
        ("max_gap", "--parameter: must be NAME=VALUE, not 'max_gap'"),
        ("max_gap=-1", "--parameter: max_gap"),
    ],
)
def test_a_parameter_that_is_none_is_refused(recording, text, expected) -> None:
    status, out, (line,) = replayed(recording, "--parameter", text)
    assert (status, out) == (2, "")
    assert expected in line
