"""A run as a user starts it, with one process for each node."""

import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from helpers.commands import isogal, sets
from isogal_ros.graph.shared_memory import abandoned_memory, shared_memory


@dataclass(frozen=True)
class Finished:
    """What a run has left behind."""

    result: subprocess.CompletedProcess
    out: Path
    abandoned: set[str]
    """Shared memory files that nobody has open."""


@pytest.fixture(scope="session")
def finished(
    tmp_path_factory: pytest.TempPathFactory, settings: Callable[..., list[str]]
) -> Finished:
    """A whole run in processes."""
    out = tmp_path_factory.mktemp("processes")
    before = shared_memory()
    result = isogal("run", *sets(settings()), "--out", out)
    end = time.monotonic() + 60.0
    while (left := abandoned_memory(before)) and time.monotonic() < end:
        time.sleep(1.0)  # what other tests have killed meanwhile they delete
    return Finished(result, out, left)
