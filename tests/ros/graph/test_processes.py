"""The graph as processes: the same numbers, and an orderly end whatever happens."""

import fcntl
import json
import os
import signal
import subprocess
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from multiprocessing import forkserver
from pathlib import Path

import numpy as np
import psutil
import pytest

from helpers.command_line import answer, call
from helpers.commands import sets, wait_for
from helpers.own_memory import left_of, own_memory
from helpers.recordings import collect, nav_positions
from helpers.small_graph import ENOUGH, has_recorded, nodes_of, small_plan, start
from isogal.evaluation.figures import style
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph import commands, running
from isogal_ros.graph.plan import GraphError
from isogal_ros.graph.running import run_processes, shared_memory, sweep_shared_memory
from isogal_ros.nodes.signals import interrupts


@pytest.fixture(scope="module")
def orphaned(tmp_path_factory):
    """What is left of a small graph whose parent is killed. It takes some seconds and mostly
    waits, thus beside other tests, but none that looks for what its own graph has left."""
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(orphans, tmp_path_factory.mktemp("orphaned"))


def orphans(folder: Path) -> set[str]:
    """Kill the parent of a small graph, wait, and return which of its nodes are still there."""
    before, process = shared_memory(), start(folder)
    nodes = {}
    try:
        wait_for(lambda: process.poll() is not None or has_recorded(folder / "bag"), "a bag")
        nodes = nodes_of(process.pid)
        assert set(nodes) == {RECORDER, topics.INS_SIM}
        process.kill()
        process.wait()
        psutil.wait_procs(nodes.values(), timeout=60)
        return {name for name, node in nodes.items() if node.is_running()}
    finally:
        kill(process, nodes)
        sweep_shared_memory(before)


def kill(process: subprocess.Popen, nodes: dict[str, psutil.Process]) -> None:
    """End what is left."""
    process.kill()
    for node in nodes.values():
        if node.is_running():
            node.kill()
    process.wait()


@pytest.mark.usefixtures("orphaned")  # which begins here
def test_a_run_in_processes_is_the_run_in_one(finished, recording) -> None:
    assert finished.result.returncode == 0, finished.result.stderr
    one, five = collect(recording), collect(finished.out / "bag")
    assert one.fixes.keys() == five.fixes.keys()
    for ns, fix in five.fix_positions().items():
        assert fix == pytest.approx(one.fix_positions()[ns], abs=1e-13)
    assert any(five.fix_positions().values())
    assert one.last_nav.keys() == five.last_nav.keys()
    np.testing.assert_allclose(nav_positions(one), nav_positions(five), atol=1e-13, rtol=0)


def test_what_a_run_leaves_behind(finished) -> None:
    result, out = finished.result, finished.out
    assert finished.mapped
    assert not finished.abandoned
    assert {"summary.json", "report.html", "bag", "log"} <= {entry.name for entry in out.iterdir()}
    assert list(out.glob("*.png"))
    summary = json.loads((out / "summary.json").read_text())
    assert summary["runs"] == 1
    assert summary["fixes"]["published"] + summary["fixes"]["declined"] == 6
    assert summary["time"]["fix_ms_median"] > 0
    assert 0 < summary["position_error"]["mean"] < 1000
    assert summary["recording"] == {"gaps": []}
    for name in (*topics.NODES, RECORDER):
        assert (out / "log" / f"{name}.log").exists()
    assert "ROS domain" in result.stderr
    assert "RMS position error (m)" in result.stdout
    assert "Traceback" not in result.stderr
    assert set(finished.memory) == {*topics.NODES, RECORDER}
    # 310 MB with all functions of the matcher loaded; a plotting package would be 60 MB more
    assert max(finished.memory.values()) < 330e6, finished.memory
    assert all(one == {"udp"} for one in finished.transports.values())


def test_the_replay_command(finished, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(style, "png", lambda *_: b"drawn before")
    out = finished.out
    document = json.loads(answer("replay", out / "bag", "--json", "--out", tmp_path / "again"))
    fixes = document["fixes"]
    assert fixes["recorded"] == fixes["replayed"] == fixes["common"] > 0
    assert document["largest_difference_m"] < 1e-6
    assert document["disagreements"] == 0
    assert document["summary"]["position_error"] == pytest.approx(
        json.loads((out / "summary.json").read_text())["position_error"], nan_ok=True
    )
    assert (tmp_path / "again" / "report.html").exists()


def test_nodes_end_with_their_parent(orphaned) -> None:
    assert orphaned.result() == set()


# last the one that ends the interpreter which nodes are forked from: a new one takes seconds
@pytest.mark.parametrize("how", ["interrupted", "a node dies", "all are told to end"])
def test_a_run_that_ends_early_leaves_a_bag_that_can_be_read(tmp_path, how) -> None:
    own, bag = set(), tmp_path / "bag"

    def report(progress) -> None:
        if own or not has_recorded(bag):  # once: it is told of progress until the end is seen
            return
        own.update(own_memory(os.getpid(), itself=False))
        nodes = nodes_of(os.getpid())
        if how == "interrupted":
            os.kill(os.getpid(), signal.SIGINT)
        elif how == "a node dies":
            nodes[RECORDER].kill()
        else:  # as a service manager does
            for node in nodes.values():
                node.terminate()
            psutil.wait_procs(nodes.values(), timeout=60)
            for pid in (forkserver._forkserver._forkserver_pid, os.getpid()):
                os.kill(pid, signal.SIGTERM)

    died = rf"^{RECORDER} ended \(killed by SIGKILL\)"
    ends = pytest.raises(GraphError, match=died) if how == "a node dies" else nullcontext()
    with ends, interrupts() as interrupt:
        run_processes(small_plan(bag), tmp_path / "log", interrupt, report)
    assert not nodes_of(os.getpid())
    assert own
    assert not left_of(own)
    reader = BagReader(bag)
    assert sum(1 for _ in reader.messages()) > ENOUGH
    assert (reader.cut is None) == (how != "a node dies")
    for log in (tmp_path / "log").glob("*.log"):
        assert "Traceback" not in log.read_text()


@pytest.mark.parametrize(
    ("how", "status", "said"),
    [
        ("interrupted", 130, "all nodes have ended. Recorded so far: BAG"),
        ("a node dies", 1, "isogal: ukf_fusion_node ended (killed by SIGKILL)"),
    ],
)
def test_the_command_says_how_a_run_has_ended(
    settings, tmp_path, monkeypatch, how, status, said
) -> None:
    bag = tmp_path / "out" / "bag"

    def ends(_plan, _folder, interrupt, *_) -> float:
        if how == "a node dies":
            raise GraphError("ukf_fusion_node ended (killed by SIGKILL)")
        interrupt(signal.SIGINT)
        return 0.0

    monkeypatch.setattr(commands, "run_processes", ends)
    code, _, err = call("run", *sets(settings()), "--out", tmp_path / "out")
    assert code == status
    assert err.splitlines()[-1].endswith(said.replace("BAG", str(bag)))


def test_only_new_files_that_nobody_uses_are_deleted(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(running, "SHARED_MEMORY", tmp_path)
    monkeypatch.setattr(running, "SETTLED", 0.0)
    for name in ("old", "abandoned", "port7", "used"):
        (tmp_path / f"fastrtps_{name}").touch()
        (tmp_path / f"fastrtps_{name}_el").touch()
    (tmp_path / "sem.fastrtps_port7_mutex").touch()
    (tmp_path / "something else").touch()
    before = {name for name in shared_memory() if "_old" in name}
    with (tmp_path / "fastrtps_used_el").open("rb") as used:
        fcntl.flock(used, fcntl.LOCK_EX)
        sweep_shared_memory(before)
    kept = {"fastrtps_old", "fastrtps_old_el", "fastrtps_used", "fastrtps_used_el"}
    assert {path.name for path in tmp_path.iterdir()} == kept | {"something else"}
