"""Nodes end when they are asked to: at any time, in time, without a traceback."""

import signal
import time

import pytest

from helpers.processes import end_all, end_as_launch_does, is_up, start_node, until
from isogal_ros import topics
from isogal_ros.graph.running import shared_memory, sweep_shared_memory
from isogal_ros.nodes.signals import INTERRUPTED


@pytest.mark.parametrize("name", [topics.UKF_FUSION, "isogal_recorder"])
def test_an_early_interrupt_says_nothing(tmp_path, name) -> None:
    """From the first import on; it once printed where the imports were."""
    before = shared_memory()
    delays = (0.0, 1.0) if name == topics.UKF_FUSION else (0.3,)
    for i, delay in enumerate(delays):
        log = tmp_path / f"{i}.log"
        own = [f"bag:={tmp_path / str(i)}"] if name == "isogal_recorder" else []
        process = start_node(name, *own, log=log)
        try:
            until(lambda process=process: is_up(process), "the first lines", process)
            time.sleep(delay)
            process.send_signal(signal.SIGINT)
            assert process.wait(60) in (INTERRUPTED, 0)
        finally:
            end_all([process])
        assert "Traceback" not in log.read_text()
        assert "Error" not in log.read_text()
    sweep_shared_memory(before)


def test_a_listener_that_died_without_goodbye_holds_nobody_up(tmp_path) -> None:
    """It once took 5 s, which is when launch sends SIGTERM: exit code -15."""
    before = shared_memory()
    logs = {name: tmp_path / f"{name}.log" for name in ("ins_sim_node", "isogal_recorder")}
    simulator = start_node(
        "ins_sim_node",
        "lock_step:=false",
        "rate:=20.0",
        "gravity.field:=normal",
        "peers:=[ins_sim_node]",
        "recorders:=1",
        log=logs["ins_sim_node"],
    )
    listener = start_node(
        "isogal_recorder", f"bag:={tmp_path / 'bag'}", log=logs["isogal_recorder"]
    )
    both = simulator, listener
    try:
        until(lambda: "begun" in logs["ins_sim_node"].read_text(), "the first step", *both)
        time.sleep(1.0)
        listener.kill()
        listener.wait()
        assert end_as_launch_does([simulator]) == [0]
    finally:
        end_all(both)
        sweep_shared_memory(before)
    assert "Traceback" not in logs["ins_sim_node"].read_text()
