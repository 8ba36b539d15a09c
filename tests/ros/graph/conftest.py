"""A run as a user starts it, with one process for each node."""

import subprocess
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from helpers.commands import isogal, sets, wait_for
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
    with suppress(AssertionError):  # what others have killed meanwhile they delete
        wait_for(lambda: not abandoned_memory(before), "the end of the shared memory", 0.5, 20.0)
    return Finished(result, out, abandoned_memory(before))
