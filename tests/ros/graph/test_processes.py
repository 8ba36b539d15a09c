"""The graph as processes: the same numbers, and an orderly end whatever happens."""

import signal
import subprocess

import numpy as np
import psutil
import pytest

from helpers.commands import PATIENCE, command, sets, wait_for
from helpers.recordings import collect, nav_positions
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.plan import CLASSES
from isogal_ros.graph.shared_memory import (
    abandoned_memory,
    shared_memory,
    sweep_shared_memory,
)


def nodes_of(process: subprocess.Popen) -> dict[str, psutil.Process]:
    """The node processes that a run has started, by name."""
    found = {}
    for child in psutil.Process(process.pid).children():
        words = child.cmdline()
        for name, (module, _) in CLASSES.items():
            if module in words:
                found[name] = child
    return found


@pytest.fixture
def running(tmp_path, settings):
    """A run in processes that has recorded something, at ten times real time; ended afterwards
    whatever happens."""
    before = shared_memory()
    process = subprocess.Popen(
        command(
            "run",
            *sets(settings("route.duration=1900.0")),
            "--rate",
            10,
            "--out",
            tmp_path / "out",
        ),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    bag = tmp_path / "out" / "bag" / "bag_0.mcap"
    wait_for(
        lambda: process.poll() is not None or (bag.exists() and bag.stat().st_size > 30_000),
        "the recording",
    )
    assert process.poll() is None, process.communicate()
    nodes = nodes_of(process)
    yield process, nodes, tmp_path / "out"
    for item in (process, *nodes.values()):
        if item.poll() is None if isinstance(item, subprocess.Popen) else item.is_running():
            item.kill()
    process.wait()
    sweep_shared_memory(before)  # a test may have killed what sweeps


def test_a_run_in_processes_is_the_run_in_one(finished, recording) -> None:
    assert finished.result.returncode == 0, finished.result.stderr
    one, five = collect(recording), collect(finished.out / "bag")
    assert one.fixes.keys() == five.fixes.keys()
    for ns, fix in five.fix_positions().items():
        assert fix == pytest.approx(one.fix_positions()[ns], abs=1e-13)
    assert any(five.fix_positions().values())
    assert one.last_nav.keys() == five.last_nav.keys()
    np.testing.assert_allclose(nav_positions(one), nav_positions(five), atol=1e-13, rtol=0)


def test_an_interrupt_ends_all_and_keeps_the_bag(running) -> None:
    process, nodes, out = running
    assert set(nodes) == set(CLASSES)
    before = shared_memory()
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "Interrupted" in err
    assert "Traceback" not in err
    assert not any(node.is_running() for node in nodes.values())
    wait_for(lambda: not abandoned_memory(before), "the end of the shared memory")
    reader = BagReader(out / "bag")
    assert sum(1 for _ in reader.messages()) > 100
    assert reader.cut is None
    for name in CLASSES:
        assert "Traceback" not in (out / "log" / f"{name}.log").read_text()


@pytest.mark.parametrize("victim", [topics.UKF_FUSION, "isogal_recorder"])
def test_a_node_that_dies_ends_the_run(running, victim) -> None:
    process, nodes, out = running
    before = shared_memory()
    nodes[victim].kill()
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert f"isogal: {victim} ended (killed by SIGKILL)" in err.strip().splitlines()[-1]
    assert not any(node.is_running() for node in nodes.values())
    wait_for(lambda: not abandoned_memory(before), "the end of the shared memory")
    reader = BagReader(out / "bag")
    assert sum(1 for _ in reader.messages()) > 100
    assert (reader.cut is not None) == (victim == "isogal_recorder")


def test_nodes_are_small_and_end_with_their_parent(running) -> None:
    process, nodes, _ = running
    for name, node in nodes.items():
        assert node.memory_info().rss < 300e6, name
    process.kill()
    process.wait()
    gone, alive = psutil.wait_procs(nodes.values(), timeout=60)
    assert not alive
    assert len(gone) == len(CLASSES)
