"""`isogal run` and `isogal replay` as a user starts them: processes, signals, results, bad
input."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader, decode
from isogal_ros.graph import domain
from isogal_ros.graph.domain import shared_memory
from isogal_ros.graph.plan import CLASSES
from isogal_ros.messages.convert import read_position

pytestmark = pytest.mark.ros
PATIENCE = 240


def command(*words: object) -> list[str]:
    return [sys.executable, "-c", "from isogal.cli.main import main; main()", *map(str, words)]


def sets(overrides: list[str]) -> list[str]:
    return [word for item in overrides for word in ("--set", item)]


def isogal(*words: object) -> subprocess.CompletedProcess:
    return subprocess.run(
        command(*words), capture_output=True, text=True, timeout=PATIENCE, check=False
    )


def collect(bag: Path) -> Collector:
    reader = BagReader(bag)
    collector = Collector(reader.scenario())
    collector.take_bag(reader)
    return collector


def nodes_of(process: subprocess.Popen) -> dict[str, psutil.Process]:
    """The node processes that a run has started, by name."""
    found = {}
    for child in psutil.Process(process.pid).children():
        words = child.cmdline()
        for name, (module, _) in CLASSES.items():
            if module in words:
                found[name] = child
    return found


def wait_for(condition, what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.05)


def orphans(before: set[str]) -> set[str]:
    """Shared memory that came since and that no process has open; other tests run at the same
    time."""
    files = {str(Path("/dev/shm") / name) for name in shared_memory() - before}
    return files - domain._open_files()


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
    domain.sweep_shared_memory(before)  # a test may have killed what sweeps


@pytest.fixture(scope="module")
def finished(tmp_path_factory, settings):
    """A whole run in processes."""
    out = tmp_path_factory.mktemp("processes")
    before = shared_memory()
    result = isogal("run", *sets(settings()), "--out", out)
    return result, out, before


def test_a_run_in_processes_is_the_run_in_one(finished, recording) -> None:
    result, out, _ = finished
    assert result.returncode == 0, result.stderr
    one, five = collect(recording), collect(out / "bag")
    assert one.fixes.keys() == five.fixes.keys()
    for ns, fix in five.fix_positions().items():
        assert fix == pytest.approx(one.fix_positions()[ns], abs=1e-13)
    assert any(five.fix_positions().values())
    assert one.last_nav.keys() == five.last_nav.keys()
    a, b = (
        [read_position(decode(store[ns], topics.NAV_FIX.type)) for ns in sorted(store)]
        for store in (one.last_nav, five.last_nav)
    )
    np.testing.assert_allclose(a, b, atol=1e-13, rtol=0)


def test_what_a_run_leaves_behind(finished) -> None:
    result, out, before = finished
    wait_for(lambda: not orphans(before), "the end of the shared memory")
    assert {"summary.json", "report.html", "bag", "log"} <= {entry.name for entry in out.iterdir()}
    assert list(out.glob("*.png"))
    summary = json.loads((out / "summary.json").read_text())
    assert summary["runs"] == 1
    assert summary["fixes"]["published"] + summary["fixes"]["declined"] == 10
    assert summary["time"]["fix_ms_median"] > 0
    assert 0 < summary["position_error"]["mean"] < 1000
    for name in CLASSES:
        assert (out / "log" / f"{name}.log").exists()
    assert "ROS domain" in result.stderr
    assert "aided navigator" in result.stdout
    assert "Traceback" not in result.stderr


def test_the_replay_command(finished, tmp_path) -> None:
    _, out, _ = finished
    result = isogal("replay", out / "bag", "--json", "--out", tmp_path / "again")
    assert result.returncode == 0, result.stderr
    document = json.loads(result.stdout)
    assert (
        document["fixes"]["recorded"]
        == document["fixes"]["replayed"]
        == document["fixes"]["common"]
        > 0
    )
    assert document["largest_difference_m"] < 1e-6
    assert document["disagreements"] == 0
    assert document["summary"]["position_error"] == pytest.approx(
        json.loads((out / "summary.json").read_text())["position_error"], nan_ok=True
    )
    assert (tmp_path / "again" / "report.html").exists()


def test_a_run_in_one_process_prints_json_and_leaves_the_home_folder_alone(
    settings, tmp_path
) -> None:
    (tmp_path / "home").mkdir()  # where ROS puts its logs unless told otherwise
    overrides = sets(settings("route.duration=120.0"))
    words = command(
        "run",
        "--in-process",
        "--json",
        *overrides,
        "--bag",
        tmp_path / "bag",
        "--out",
        tmp_path / "out",
    )
    environment = os.environ | {"HOME": str(tmp_path / "home")}
    result = subprocess.run(
        words, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    assert not (tmp_path / "home" / ".ros").exists()


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
    wait_for(lambda: not orphans(before), "the end of the shared memory")
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
    wait_for(lambda: not orphans(before), "the end of the shared memory")
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


BAD = [
    (("run", "--set", "matcher.batch_lenght=5"), "did you mean 'matcher.batch_length'?"),
    (("run", "--set", "gravimeter.sigma=-1e-5"), "gravimeter.sigma"),
    (("run", "--set", "map.source=none.nc"), "none.nc: no such file"),
    (("run", "--scenario", "none.yaml"), "none.yaml: cannot be read: No such file or directory"),
    (
        (
            "run",
            "SETTINGS",
            "--set",
            "route.end=[-30.0, 147.0]",
            "--set",
            "route.duration=10000.0",
        ),
        "does not cover the route",
    ),
    (("run", "SETTINGS", "--set", "matcher.options={nonsense: 1}"), "nonsense"),
    (("run", "SETTINGS", "--out", "TMP/file/out"), "cannot be made: Not a directory"),
    (
        ("run", "SETTINGS", "--bag", "TMP/bag", "--out", "TMP/out"),
        "there is a bag already; give another folder",
    ),
    (("run", "SETTINGS", "--rate", "-1"), "--rate"),
    (("replay", "TMP/none"), "no such bag"),
    (("replay", "TMP/no.mcap"), "not an MCAP file"),
]


@pytest.mark.parametrize(("words", "expected"), BAD, ids=[expected for _, expected in BAD])
def test_bad_input_is_one_line_and_exit_2(
    settings, tmp_path, monkeypatch, capsys, words, expected
) -> None:
    from isogal.cli.main import main

    (tmp_path / "file").write_text("x")
    (tmp_path / "no.mcap").write_bytes(b"no bag")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").touch()
    line = []
    for word in words:
        line += sets(settings()) if word == "SETTINGS" else [word.replace("TMP", str(tmp_path))]
    monkeypatch.setattr(sys, "argv", ["isogal", *line])
    with pytest.raises(SystemExit) as end:
        main()
    out, err = capsys.readouterr()
    (message,) = [text for text in err.strip().splitlines() if not text.startswith("Preparing")]
    assert end.value.code == 2
    assert message.startswith("isogal: ")
    assert expected in message
    assert out == ""


def test_without_ros_the_command_says_so(monkeypatch) -> None:
    import importlib.util

    from isogal.cli import run

    monkeypatch.setattr(
        run, "find_spec", lambda name: None if name == "rclpy" else importlib.util.find_spec(name)
    )
    with pytest.raises(InputError, match=r"ROS 2 \(rclpy\) is not installed"):
        run.run()
    with pytest.raises(InputError, match=r"ROS 2 \(rclpy\) is not installed"):
        run.replay(Path("bag"))
