"""What the middleware is told before a node joins it, and a process that stood still."""

import os
from pathlib import Path

import pytest

from helpers.node_bench import bench
from isogal_ros import topics
from isogal_ros.nodes import heartbeat, spin
from isogal_ros.nodes.health import ERROR
from isogal_ros.nodes.middleware import LEASE, OWN_FILES, PROFILES


class ReachedError(Exception):
    """rclpy.init was called."""


@pytest.fixture
def environment_at_init(monkeypatch):
    """What is in the environment when a node that is run by itself joins the middleware."""
    for name in (*PROFILES, *OWN_FILES):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    seen = {}

    def init(**_keys) -> None:
        seen.update(os.environ)
        raise ReachedError

    monkeypatch.setattr(spin.rclpy, "init", init)

    def run() -> dict[str, str]:
        with pytest.raises(ReachedError):
            spin.run_node("node", lambda: None, [])
        return seen

    return run


def test_a_node_that_is_run_by_itself_sets_the_profiles(environment_at_init) -> None:
    seen = environment_at_init()
    assert {name: seen[name] for name in PROFILES} == PROFILES
    assert "udpv4" in Path(seen[OWN_FILES[0]]).read_text()


def test_a_process_that_stood_still_says_so_for_a_minute(scenario, monkeypatch) -> None:
    now = 1000.0
    monkeypatch.setattr(heartbeat.time, "monotonic", lambda: now)
    with bench(topics.GRAVIMETER, scenario()) as made:
        made.bus.alone = False
        beat = made.node._beat
        for after in (1.0, LEASE - 1.0):  # for so long others keep what they publish
            now += after
            beat()
            assert "stood still" not in made.says()[-1][1]
        now += LEASE + 10.0
        beat()
        assert made.says()[-1][0] == ERROR
        assert "stood still for 30 s" in made.says()[-1][1]
        for _ in range(70):
            now += 1.0
            beat()
        assert "stood still" not in made.says()[-1][1]
        assert made.says()[-1][2]["stood still"] == "1"


def test_a_node_that_nobody_hears_may_take_its_time(scenario, monkeypatch) -> None:
    """To compile on a busy machine once made a replay say that messages were lost."""
    now = 1000.0
    monkeypatch.setattr(heartbeat.time, "monotonic", lambda: now)
    with bench(topics.GRAVIMETER, scenario()) as made:
        made.node._beat()
        now += LEASE + 10.0
        made.node._beat()
        assert "stood still" not in made.says()[-1][1]
