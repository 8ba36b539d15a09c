"""Tiles of the synthetic map in the cache: whole or absent, damage found, shared by processes."""

import multiprocessing
import time

import numpy as np
import pytest

from isogal.maps.cache import cache_folder
from isogal.maps.synthetic import tiles

ARRAYS = {"gravity": np.arange(3), "height": np.full((40, 50), 7)}
TILE = -38, 144


@pytest.fixture
def made(monkeypatch, tmp_path):
    """Tiles that were made, all in this process; each takes a moment."""
    made = []

    def make_tile(*corner):
        (tmp_path / "log").open("a").write(f"{corner}\n")
        time.sleep(0.05)
        made.append(corner)
        return ARRAYS

    monkeypatch.setenv("ISOGAL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(tiles, "make_tile", make_tile)
    monkeypatch.setattr(tiles.sys, "executable", "/nonexistent/python")
    return made


@pytest.mark.parametrize("damage", ["absent", "empty", "cut", "flipped", "foreign"])
def test_damage_is_found_and_repaired(made, damage):
    ((tile, found),) = tiles.read_tiles("gravity", [TILE])
    np.testing.assert_array_equal(found, ARRAYS["gravity"])
    path = tiles._path(tile)
    body = path.read_bytes()
    at = body.index(ARRAYS["height"].tobytes()) + 800
    path.unlink()
    if damage != "absent":
        flipped = body[:at] + bytes([body[at] ^ 1]) + body[at + 1 :]
        spoilt = {"empty": b"", "cut": body[:-3], "flipped": flipped, "foreign": b"PK" * 40}
        path.write_bytes(spoilt[damage])
    for _ in range(2):
        ((_, found),) = tiles.read_tiles("height", [TILE])
        np.testing.assert_array_equal(found, ARRAYS["height"])
    assert made == [TILE, TILE]


def test_without_a_writable_folder_arrays_are_made_and_not_kept(
    made, tmp_path, caplog, monkeypatch
):
    file = tmp_path / "file"
    file.write_text("not a folder")
    monkeypatch.setenv("ISOGAL_CACHE", str(file))
    assert [len(found) for _, found in tiles.read_tiles("gravity", [TILE, (0, 0)])] == [3, 3]
    assert made == [TILE, (0, 0)]
    (said,) = caplog.messages  # once
    assert "file/synthetic-1 cannot be written" in said


def read_all():
    assert len(list(tiles.read_tiles("gravity", [(south, 0) for south in range(6)]))) == 6


def test_processes_share_the_work(made, tmp_path):
    fork = multiprocessing.get_context("fork")
    processes = [fork.Process(target=read_all) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60.0)
    assert [process.exitcode for process in processes] == [0] * 3
    assert len((tmp_path / "log").read_text().splitlines()) == 6


def test_folder_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("ISOGAL_CACHE", str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"
    monkeypatch.delenv("ISOGAL_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "isogal"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "isogal"
