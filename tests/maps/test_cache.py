"""Cache files: whole or absent, damage found, shared between processes."""

import multiprocessing
import time
from functools import partial

import numpy as np
import pytest

from isogal.maps.cache import cache_folder, read_array, read_or_make

ARRAYS = {"first": np.arange(3), "none": np.zeros(0), "third": np.full((40, 50), 7)}


def kept(path):
    """Make a cache file, and return its path."""
    ((_, made),) = read_or_make({path: lambda: ARRAYS}, "first")
    np.testing.assert_array_equal(made, ARRAYS["first"])
    assert read_array(path, "fourth") is None
    return path


@pytest.mark.parametrize("damage", ["absent", "empty", "cut", "flipped", "foreign"])
def test_damage_is_found_and_repaired(tmp_path, damage):
    path = kept(tmp_path / "a.npz")
    body = path.read_bytes()
    at = body.index(ARRAYS["third"].tobytes()) + 800
    path.unlink()
    if damage != "absent":
        flipped = body[:at] + bytes([body[at] ^ 1]) + body[at + 1 :]
        spoilt = {"empty": b"", "cut": body[:-3], "flipped": flipped, "foreign": b"PK" * 40}
        path.write_bytes(spoilt[damage])
    assert read_array(path, "third") is None
    ((_, made),) = read_or_make({path: lambda: ARRAYS}, "third")
    for array in (made, read_array(path, "third")):
        np.testing.assert_array_equal(array, ARRAYS["third"])


def test_without_a_writable_folder_arrays_are_made_and_not_kept(tmp_path, caplog):
    file = tmp_path / "file"
    file.write_text("not a folder")
    calls = []
    makers = {file / name: lambda: calls.append(1) or ARRAYS for name in ("a.npz", "b.npz")}
    (_, made), _ = read_or_make(makers, "first")
    assert len(made) == 3 and len(calls) == 2
    said = f"isogal: the cache {file} cannot be written (File exists): goes on without"
    assert caplog.messages == [said]  # once


def share(folder):
    """Make six arrays, or take those that another process has made."""

    def make(name):
        with (folder / "log").open("a") as log:
            log.write(name + "\n")
        time.sleep(0.1)
        return {"name": np.array(name)}

    makers = {folder / "t" / f"{name}.npz": partial(make, name) for name in "abcdef"}
    got = {path.stem: str(array) for path, array in read_or_make(makers, "name")}
    assert got == {name: name for name in "abcdef"}


def test_processes_share_the_work(tmp_path):
    fork = multiprocessing.get_context("fork")
    processes = [fork.Process(target=share, args=(tmp_path,)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60.0)
    assert [process.exitcode for process in processes] == [0] * 3
    assert sorted((tmp_path / "log").read_text().split()) == list("abcdef")


def test_folder_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("ISOGAL_CACHE", str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"
    monkeypatch.delenv("ISOGAL_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "isogal"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "isogal"
