"""A run as a user starts it, with one process for each node."""

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from helpers.commands import PATIENCE, command, sets
from helpers.own_memory import left_of, own_memory


@dataclass(frozen=True)
class Finished:
    """What a run has left behind."""

    result: subprocess.CompletedProcess
    out: Path
    mapped: set[Path]
    """Shared memory files that its processes used."""
    abandoned: set[Path]
    """Those of them that are still there."""


@pytest.fixture(scope="session")
def finished(
    tmp_path_factory: pytest.TempPathFactory, settings: Callable[..., list[str]]
) -> Finished:
    """A whole run in processes."""
    out = tmp_path_factory.mktemp("processes")
    words = command("run", *sets(settings()), "--out", out)
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    own: set[Path] = set()
    for _ in range(round(PATIENCE)):
        try:
            said, complained = process.communicate(timeout=1.0)
            break
        except subprocess.TimeoutExpired:
            own |= own_memory(process.pid)
    else:
        process.kill()
        pytest.fail("the run does not end")
    result = subprocess.CompletedProcess(words, process.returncode, said, complained)
    return Finished(result, out, own, left_of(own))
