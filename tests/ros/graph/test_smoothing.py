"""`isogal smooth`: a recorded voyage, afterwards."""

import csv
import json
import shutil

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from helpers.command_line import answer, refusal
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.messages.prepared import peek_ns


@pytest.fixture(scope="module")
def smoothed(recording, tmp_path_factory):
    out = tmp_path_factory.mktemp("smoothed")
    return out, json.loads(answer("smooth", str(recording), "--out", str(out), "--json"))


def test_what_it_says_of_its_errors(smoothed) -> None:
    """Of one run of six minutes, by a matcher that is overconfident, they may be any."""
    _, found = smoothed
    error, nees = found["position_error_rms"], found["nees_per_axis"]
    assert error["smoothed"] != error["at_the_time"]
    assert max(error.values()) < 300.0
    assert min(nees.values()) > 0.0
    assert found["states"] == 360


def test_its_files_and_its_bag_hold_the_same(smoothed) -> None:
    out, _ = smoothed
    with (out / "smoothed.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    messages = [one for one in BagReader(out / "bag").messages() if one.topic == "/nav/smoothed"]
    assert [float(row["time"]) for row in rows] == [peek_ns(one.data) / 1e9 for one in messages]
    last = deserialize_message(messages[-1].data, topics.SMOOTHED.type)
    variances = np.reshape(last.pose.covariance, (6, 6)).diagonal()[:2]
    assert float(rows[-1]["covariance_north_north"]) == pytest.approx(variances[1], rel=0.02)
    assert BagReader(out / "bag").scenario() is not None


def test_fewer_rows(recording, tmp_path) -> None:
    words = "--interval", "60", "--set", "initial_error.position=200"
    printed = answer("smooth", str(recording), "--out", str(tmp_path), *words)
    assert "RMS position error (m)" in printed and "smoothed.gpx" in printed
    with (tmp_path / "smoothed.csv").open(encoding="utf-8") as stream:
        times = [float(row["time"]) for row in csv.DictReader(stream)]
    assert times == [1.0, 61.0, 121.0, 181.0, 241.0, 301.0, 360.0]


def test_a_recording_is_not_written_over(recording, tmp_path) -> None:
    """`isogal smooth out/demo --out out/demo` would."""
    shutil.copytree(recording, tmp_path / "bag")
    before = sorted((path.name, path.stat().st_size) for path in (tmp_path / "bag").iterdir())
    assert "holds a recording" in refusal("smooth", str(tmp_path), "--out", str(tmp_path))
    assert before == sorted((one.name, one.stat().st_size) for one in (tmp_path / "bag").iterdir())


def test_what_cannot_be_smoothed(tmp_path) -> None:
    assert "no such recording" in refusal("smooth", str(tmp_path / "nothing"))
    (tmp_path / "results.json").write_text("{}")
    assert "montecarlo --smooth" in refusal("smooth", str(tmp_path))
