"""Cache files: whole or absent, damage found, shared between processes."""

import os
import subprocess
import sys

import pytest

from isogal.maps.cache import cache_folder, read_or_make, read_part, write_parts

PARTS = (b"first", b"", b"third" * 1000)


def test_parts_come_back(tmp_path):
    write_parts(tmp_path / "a", PARTS)
    assert [read_part(tmp_path / "a", i) for i in range(4)] == [*PARTS, None]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a"]


@pytest.mark.parametrize("damage", ["absent", "empty", "cut", "longer", "flipped", "foreign"])
def test_damage_is_found_and_repaired(tmp_path, damage):
    path = tmp_path / "a"
    write_parts(path, PARTS)
    body = path.read_bytes()
    path.unlink()
    if damage != "absent":
        flipped = body[:-7] + bytes([body[-7] ^ 1]) + body[-6:]
        path.write_bytes(
            {
                "empty": b"",
                "cut": body[:-3],
                "longer": body + b"x",
                "flipped": flipped,
                "foreign": b"PK" * 40,
            }[damage]
        )
    assert read_part(path, 2) is None
    assert dict(read_or_make({path: lambda: PARTS}, 2)) == {path: PARTS[2]}
    assert read_part(path, 2) == PARTS[2]


def test_without_a_writable_folder_parts_are_made_and_not_kept(tmp_path):
    file = tmp_path / "file"
    file.write_text("not a folder")
    calls = []
    made = dict(read_or_make({file / "a": lambda: calls.append(1) or PARTS}, 0))
    assert made == {file / "a": PARTS[0]} and len(calls) == 1


SHARE = """
import sys, time
from pathlib import Path
from isogal.maps.cache import read_or_make
folder = Path(sys.argv[1])
def make(name):
    with (folder / "log").open("a") as log:
        log.write(name + "\\n")
    time.sleep(0.2)
    return [name.encode()]
got = dict(read_or_make({folder / "t" / n: (lambda n=n: make(n)) for n in "abcdef"}, 0))
assert {p.name: b.decode() for p, b in got.items()} == {n: n for n in "abcdef"}
"""


def test_processes_share_the_work(tmp_path):
    processes = [
        subprocess.Popen([sys.executable, "-c", SHARE, str(tmp_path)], env=dict(os.environ))
        for _ in range(4)
    ]
    assert [p.wait(timeout=60) for p in processes] == [0] * 4
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
