"""Nodes end when they are asked to: at any time, in time, without a traceback."""

import os
import signal
import time
from pathlib import Path

import pytest

from helpers.node_bench import bench
from helpers.processes import end_all, is_up, start_node, until
from isogal_ros import topics
from isogal_ros.graph.running import shared_memory, sweep_shared_memory
from isogal_ros.nodes import heartbeat, spin
from isogal_ros.nodes.health import ERROR
from isogal_ros.nodes.middleware import LEASE, OWN_FILES, PROFILES
from isogal_ros.nodes.signals import INTERRUPTED


@pytest.mark.parametrize(("delay", "number"), [(0.0, signal.SIGINT), (3.0, signal.SIGHUP)])
def test_an_early_interrupt_says_nothing(tmp_path, delay, number) -> None:
    """From the first import on; it once printed where the imports were. A terminal that is closed
    ends a node as Ctrl-C does."""
    before, log = shared_memory(), tmp_path / "log"
    process = start_node(topics.UKF_FUSION, log=log)
    try:
        until(lambda: is_up(process), "the first lines", process)
        time.sleep(delay)
        process.send_signal(number)
        assert process.wait(60) in (INTERRUPTED, 0)
    finally:
        end_all([process])
    assert "Traceback" not in log.read_text()
    assert "Error" not in log.read_text()
    sweep_shared_memory(before)


def test_a_node_that_is_run_by_itself_sets_the_profiles(monkeypatch) -> None:
    """Before it joins the middleware."""
    for name in (*PROFILES, *OWN_FILES):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    seen = {}

    def init(**_keys) -> None:
        seen.update(os.environ)
        raise KeyError("reached")

    monkeypatch.setattr(spin.rclpy, "init", init)
    with pytest.raises(KeyError, match="reached"):
        spin.run_node("node", lambda: None, [])
    assert {name: seen[name] for name in PROFILES} == PROFILES
    assert "udpv4" in Path(seen[OWN_FILES[0]]).read_text()


def test_a_process_that_stood_still_says_so_for_a_minute_unless_nobody_hears_it(
    scenario, monkeypatch
) -> None:
    """To compile on a busy machine once made a replay say that messages were lost."""
    now = 1000.0
    monkeypatch.setattr(heartbeat.time, "monotonic", lambda: now)
    with bench(topics.GRAVIMETER, scenario()) as made:
        beat = made.node._beat
        beat()
        now += LEASE + 10.0
        beat()
        made.bus.alone = False
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
