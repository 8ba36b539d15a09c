"""A run as a user starts it, with one process for each node."""

import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import psutil
import pytest

from helpers.batches import field_map_of, wavy
from helpers.commands import PATIENCE, command, sets
from helpers.own_memory import left_of, own_memory
from helpers.small_graph import nodes_of
from isogal.maps.formats.netcdf_writing import write_netcdf

LOOK = 0.2
"""s between looks at what a run's processes have: the nodes are there for a few seconds."""


@dataclass(frozen=True)
class Finished:
    """What a run has left behind."""

    out: Path
    result: subprocess.CompletedProcess | None = None
    mapped: set[Path] = field(default_factory=set)
    """Shared memory files that its processes used."""
    memory: dict[str, int] = field(default_factory=dict)
    """Bytes that each node had when it was looked at last."""
    transports: dict[str, set[str]] = field(default_factory=dict)
    """By which of Fast DDS's transports each node listened."""

    def look(self, pid: int) -> None:
        """Note what the nodes of a process that runs have."""
        self.mapped.update(own_memory(pid))
        for name, node in nodes_of(pid).items():
            try:
                self.memory[name] = node.memory_info().rss
            except psutil.Error:  # it has just ended
                continue
            self.transports.setdefault(name, set()).update(listens_by(node.pid))

    @property
    def abandoned(self) -> set[Path]:
        """Shared memory files that are still there."""
        return left_of(self.mapped)


def listens_by(pid: int) -> set[str]:
    """Return by which of Fast DDS's transports a process listens: each has threads named
    dds.TRANSPORT.PORT."""
    found = set()
    for path in Path(f"/proc/{pid}/task").glob("*/comm"):
        try:
            found.add(re.fullmatch(r"dds\.(udp|shm|tcp)\.\d+", path.read_text().strip()))
        except OSError:  # it has just ended
            continue
    return {match[1] for match in found if match}


@pytest.fixture(scope="session")
def magnetic_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of the magnetic anomaly beside that of `map_file`, turned by a right angle."""
    path = tmp_path_factory.mktemp("maps") / "magnetic.nc"
    turned = field_map_of(lambda north, east: 1e6 * wavy(-east + 7e3, north), step=500.0)
    write_netcdf(replace(turned, unit="nT", quantity="magnetic_anomaly"), path)
    return path


@pytest.fixture(scope="session")
def finished(
    tmp_path_factory: pytest.TempPathFactory, settings: Callable[..., list[str]], recording: Path
) -> Finished:
    """A whole run in processes; after one in this process, so that no node compiles anything,
    which takes memory."""
    made = Finished(tmp_path_factory.mktemp("processes"))
    words = command("run", *sets(settings()), "--out", made.out)
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    for _ in range(round(PATIENCE / LOOK)):
        try:
            said, complained = process.communicate(timeout=LOOK)
            break
        except subprocess.TimeoutExpired:
            made.look(process.pid)
    else:
        process.kill()
        pytest.fail("the run does not end")
    result = subprocess.CompletedProcess(words, process.returncode, said, complained)
    return replace(made, result=result)
