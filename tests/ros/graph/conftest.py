"""A run as a user starts it, with one process for each node."""

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from helpers.commands import isogal, sets
from isogal_ros.graph.shared_memory import shared_memory


@dataclass(frozen=True)
class Finished:
    """What a run has left behind."""

    result: subprocess.CompletedProcess
    out: Path
    before: set[str]
    """Shared memory files that were there before it."""


@pytest.fixture(scope="session")
def finished(
    tmp_path_factory: pytest.TempPathFactory, settings: Callable[..., list[str]]
) -> Finished:
    """A whole run in processes."""
    out = tmp_path_factory.mktemp("processes")
    before = shared_memory()
    return Finished(isogal("run", *sets(settings()), "--out", out), out, before)
