"""`isogal run` and `isogal replay` as a user starts them: results and bad input."""

import importlib.util
import json

import pytest

from helpers.command_line import call
from helpers.commands import sets
from helpers.recordings import rewritten
from isogal.cli import run
from isogal.scenario import load_scenario
from isogal_ros.faults import campaign


def test_a_replay_beyond_the_tolerance_fails(recording) -> None:
    """Changed on purpose, any difference will do, unless a tolerance is given."""
    change = ("--set", "initial_error.position=300", "--json")
    code, out, _ = call("replay", recording, *change)
    assert code == 0
    assert json.loads(out)["largest_difference_m"] > 0.01
    code, _, err = call("replay", recording, *change, "--tolerance", "0.01")
    assert code == 1
    assert "tolerance 0.01 m" in err


def test_a_bag_without_scenario_is_refused(recording, tmp_path) -> None:
    """Rewritten by another tool; it once was replayed with the default scenario, exit 0."""
    rewritten(recording, tmp_path / "poor", texts={})
    code, _, err = call("replay", tmp_path / "poor")
    assert code == 2
    assert "the bag has no scenario" in err


BAD = [
    (("run", "--scenario", "none.yaml"), "none.yaml: cannot be read: No such file or directory"),
    (
        ("run", "SETTINGS", *sets(("route.end=[-30.0, 147.0]", "route.duration=10000.0"))),
        "does not cover the route",
    ),
    (("run", "SETTINGS", "--out", "TMP/file/out"), "cannot be written"),
    (
        ("run", "SETTINGS", "--bag", "TMP/bag", "--out", "TMP/out"),
        "there is a bag already; give another folder",
    ),
    (("run", "SETTINGS", "--port", "8080"), "--port 8080: goes with --live"),
    (
        ("run", "SETTINGS", "--in-process", "--respawn"),
        "--respawn: nodes in one process cannot be started again one by one",
    ),
    (
        ("run", "SETTINGS", "--set", "route.duration=5"),
        "route: takes 5 s, and the first reading comes after 10 s",
    ),
    (("replay", "TMP/none"), "no such bag"),
]


@pytest.mark.parametrize(("words", "expected"), BAD, ids=[expected for _, expected in BAD])
def test_bad_input_is_one_line_and_exit_2(settings, tmp_path, words, expected) -> None:
    """Before any node starts."""
    (tmp_path / "file").write_text("x")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").touch()
    line = []
    for word in words:
        line += sets(settings()) if word == "SETTINGS" else [word.replace("TMP", str(tmp_path))]
    status, out, err = call(*line)
    (message,) = [text for text in err.strip().splitlines() if not text.startswith("Preparing")]
    assert status == 2
    assert message.startswith("isogal: ")
    assert expected in message
    assert out == ""
    assert "ROS domain" not in err


def test_a_domain_that_is_none_is_refused_before_the_map_is_made(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "abc")
    status, out, err = call("run", "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert err == "isogal: ROS_DOMAIN_ID: must be a number from 0 to 232, not 'abc'\n"
    assert not (tmp_path / "out").exists()


def test_the_faults_command_ends_with_the_status_of_the_campaign(
    settings, tmp_path, monkeypatch
) -> None:
    asked = []
    monkeypatch.setattr(
        campaign, "run_campaign", lambda *words: asked.append(words) or {"failed": 1}
    )
    words = ("--quick", "--trials", 3, "--json", "--out", tmp_path / "f")
    status, out, _ = call("faults", *sets(settings()), *words)
    assert (status, json.loads(out)) == (1, {"failed": 1})
    ((scenario, folder, trials, quick, *_),) = asked
    assert scenario == load_scenario(None, settings())
    assert (folder, trials, quick) == (tmp_path / "f", 3, True)


@pytest.mark.parametrize("words", [("run",), ("replay", "bag"), ("faults", "--out", "out")])
def test_without_ros_the_command_says_so(monkeypatch, words) -> None:
    monkeypatch.setattr(
        run, "find_spec", lambda name: None if name == "rclpy" else importlib.util.find_spec(name)
    )
    status, _, err = call(*words)
    assert status == 2
    assert "ROS 2 (rclpy) is not installed" in err
