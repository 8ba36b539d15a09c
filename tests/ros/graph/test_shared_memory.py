"""Files that killed processes leave behind."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from isogal_ros.graph import shared_memory as module
from isogal_ros.graph.shared_memory import abandoned_memory, shared_memory, sweep_shared_memory


def age(folder: Path, seconds: float = 10.0) -> None:
    """Make all files as old as that."""
    for entry in folder.iterdir():
        os.utime(entry, times=(time.time() - seconds,) * 2)


@pytest.fixture
def folder(monkeypatch, tmp_path) -> Path:
    """What stands for /dev/shm."""
    monkeypatch.setattr(module, "_FOLDER", tmp_path)
    return tmp_path


def test_only_files_that_nobody_has_open_are_deleted(folder) -> None:
    (folder / "fastrtps_old").touch()
    before = shared_memory()
    (folder / "fastrtps_abandoned").touch()
    (folder / "sem.fastrtps_abandoned_mutex").touch()
    (folder / "fastrtps_used").write_bytes(b"x")
    (folder / "something else").touch()
    age(folder)
    code = f"stream = open({str(folder / 'fastrtps_used')!r}); print('open', flush=True); input()"
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "open\n"
        assert abandoned_memory(before) == {
            "fastrtps_abandoned",
            "sem.fastrtps_abandoned_mutex",
        }
        sweep_shared_memory(before)
        process.communicate("\n")
    assert sorted(entry.name for entry in folder.iterdir()) == [
        "fastrtps_old",
        "fastrtps_used",
        "something else",
    ]


def test_files_that_are_just_being_made_are_left_alone(folder, monkeypatch) -> None:
    (folder / "fastrtps_abandoned").touch()
    age(folder)
    for name in ("fastrtps_new", "fastrtps_new_el", "fastrtps_late"):
        (folder / name).touch()
    assert abandoned_memory(set()) == {"fastrtps_abandoned"}
    taken_up = []

    def sleep(seconds: float) -> None:
        assert seconds == module.SETTLED
        assert {entry.name for entry in folder.iterdir()} == {
            "fastrtps_new",
            "fastrtps_new_el",
            "fastrtps_late",
        }
        (folder / "fastrtps_newer").touch()
        taken_up.extend((folder / name).open("rb") for name in ("fastrtps_new", "fastrtps_new_el"))

    monkeypatch.setattr(module.time, "sleep", sleep)
    # this process counts as one that no longer needs its own, so another one has to hold them
    monkeypatch.setattr(module.os, "getpid", lambda: 0)
    sweep_shared_memory(set())
    assert {entry.name for entry in folder.iterdir()} == {
        "fastrtps_new",
        "fastrtps_new_el",
        "fastrtps_newer",
    }
    for stream in taken_up:
        stream.close()


def test_old_files_cost_no_wait(folder, monkeypatch) -> None:
    (folder / "fastrtps_abandoned").touch()
    age(folder)
    monkeypatch.setattr(module.time, "sleep", lambda seconds: pytest.fail("waits"))
    sweep_shared_memory(set())
    assert list(folder.iterdir()) == []
