"""Cases to compute, and the chunks of runs that workers compute one at a time."""

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

import isogal
from isogal.evaluation.records import FORMAT, Runs
from isogal.fields.scenario_map import true_map
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.several import RunMap, each_map
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory

MEMORY = 256_000_000
"""Bytes that the arrays of one chunk may take in a worker."""
MOST_RUNS = 10
"""Runs of a chunk at most: an interruption loses no more than that, at the end of a study the last
worker does not keep the others idle for longer than that, and progress is shown by chunks."""
_CODE = (
    "earth",
    "inertial",
    "sensors",
    "maps",
    "fields",
    "matching",
    "fusion",
    "evaluation/records.py",
    "montecarlo/engine.py",
    "montecarlo/recorder.py",
)


@dataclass(frozen=True, eq=False)
class Case:
    """Runs 0 to `runs` - 1 of a scenario on a map."""

    name: str
    scenario: Scenario
    runs: int
    field_map: RunMap
    aided: bool = True
    """False: no fix is ever taken; shows the inertial navigator and its filter by themselves."""
    smooth: bool = False
    """Whether the states of each run are smoothed, too."""

    @cached_property
    def duration(self) -> float:
        """Simulated time of a run, s; raises InputError where the route is shorter than the
        scenario asks for."""
        return float(build_trajectory(self.scenario).time[-1])

    @cached_property
    def key(self) -> str:
        """Hash of everything that the runs' numbers depend on: scenario, map, recorded track and
        readings, format of the records, and the library's source."""
        parts = {
            "isogal": isogal.__version__,
            "code": source_digest(),
            "format": FORMAT,
            # what is promised of the errors does not change them
            "scenario": self.scenario.model_dump(mode="json", exclude={"integrity"}),
            "map": map_digest(self.field_map),
            "aided": self.aided,
            "smooth": self.smooth,
        }
        each = self.scenario.each_field
        if any("map" in one.truth for one in each):
            route = build_trajectory(self.scenario)
            sources = [
                map_digest(true_map(one, route, its_map))
                for one, its_map in zip(each, each_map(self.field_map), strict=True)
            ]
            parts["true map"] = sources[0] if len(sources) == 1 else sources
        recorded = [self.scenario.route.track, *(one.readings.source for one in each)]
        if files := sorted({Path(file) for file in recorded if file is not None}):
            parts["recorded"] = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:24]


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some runs of a case."""

    case: Case
    runs: tuple[int, ...]

    @property
    def seconds(self) -> float:
        """Simulated time of its runs together, s."""
        return self.case.duration * len(self.runs)

    @property
    def task(self) -> "Task":
        """What a worker needs to know of it."""
        case = self.case
        return Task(map_digest(case.field_map), case.scenario, self.runs, case.aided, case.smooth)

    def __str__(self) -> str:
        first, last = self.runs[0], self.runs[-1]
        which = f"run {first}" if first == last else f"runs {first} to {last}"
        return f"{self.case.name}, {which}"


class Task(NamedTuple):
    """A chunk as it is sent to a worker; maps are sent once, under their digests."""

    map_key: str
    scenario: Scenario
    runs: tuple[int, ...]
    aided: bool
    smooth: bool


def compute(task: Task, field_map: RunMap) -> Runs:
    """Compute a task on the map of its key; raises InputError where the scenario cannot be
    used."""
    matcher = None if task.aided else Unaided()
    lag = math.inf if task.smooth else 0.0
    return simulate(task.scenario, task.runs, field_map, matcher, lag=lag)


class Unaided:
    """A matcher that never gives a fix."""

    name = "unaided"
    context = 0
    takes_channels = True

    def match(self, batch: Batch, field_map: AnyMap, memory: None) -> tuple[Fix, None]:
        """Decline (see `isogal.matching.interfaces.Matcher`)."""
        return declined(batch, "unaided"), None


def divide(case: Case, missing: Sequence[int], share: int) -> list[Chunk]:
    """Cut the missing runs of a case into chunks of at most `share` runs (see `fair_share`) that
    fit into memory."""
    size = min(share, fitting(case.scenario, case.duration))
    return [Chunk(case, tuple(missing[i : i + size])) for i in range(0, len(missing), size)]


def fair_share(runs: int, workers: int) -> int:
    """Return how many of so many runs a chunk may have, so that all workers are busy to the
    end."""
    return min(MOST_RUNS, max(1, math.ceil(runs / (8 * workers))))


def fitting(scenario: Scenario, duration: float) -> int:
    """Return how many runs of a scenario of so many seconds can be computed together within
    `MEMORY`, at least one.

    A run holds six IMU readings and the unaided track of every step, and about 100 numbers of
    every scan. All runs share the truth, the samples of the run being simulated, and the
    covariance of the map's error between all scans."""
    intervals, scans = duration * scenario.navigation_rate, duration / scenario.scan_interval
    samples = duration * scenario.imu.rate
    wrong = sum(one.map_error.sigma > 0.0 for one in scenario.each_field)
    shared = 8 * (40 * samples + 5 * wrong * scans**2)
    each = 8 * (9 * intervals + 100 * scans) + 200_000
    return max(1, int((MEMORY - shared) / each))


@cache
def source_digest() -> str:
    """Return a hash of the source files that results depend on, so that results of other source
    code are not taken for those of this one."""
    root = Path(isogal.__file__).parent
    digest = hashlib.sha256()
    for path in [
        *sorted(root.glob("*.py")),
        *(f for part in _CODE for f in _python_files(root / part)),
    ]:
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _python_files(path: Path) -> list[Path]:
    return sorted(path.rglob("*.py")) if path.is_dir() else [path]


@cache
def map_digest(field_map: RunMap) -> str:
    """Return a hash of a map's numbers, which identifies it to workers. Maps do not change."""
    digest = hashlib.sha256()
    for channel in (one for each in each_map(field_map) for one in channels_of(each)):
        for part in channel.parts():
            sigma = np.asarray(part.sigma)
            for array in (part.latitude, part.longitude, sigma, part.values):
                digest.update(f"{array.shape} {array.dtype}".encode())
                digest.update(np.ascontiguousarray(array).data)
            rest = (part.unit, part.quantity, part.correlation_length, part.quantisation)
            digest.update(repr(rest).encode())
    return digest.hexdigest()[:16]
