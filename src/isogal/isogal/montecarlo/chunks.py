"""Cases to compute, and the chunks of runs that workers compute one at a time."""

import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import isogal
from isogal.evaluation.records import FORMAT, Runs
from isogal.fields.scenario_map import true_map
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.several import RunMap, each_map
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.montecarlo.engine import Progress, simulate
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory

MEMORY = 256_000_000
"""Bytes that the arrays of one chunk may take in a worker."""
MOST_RUNS = 25
"""Runs of a chunk at most: an interruption loses no more than that, and at the end of a study the
last worker does not keep the others idle for longer than that."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Runs 0 to `runs` - 1 of a scenario on a map."""

    name: str
    scenario: Scenario
    runs: int
    field_map: RunMap
    aided: bool = True
    """False: no fix is ever taken; shows the inertial navigator and its filter by themselves."""

    @property
    def duration(self) -> float:
        """Simulated time of a run, s; raises InputError where the route is shorter than the
        scenario asks for."""
        return float(build_trajectory(self.scenario).time[-1])

    @property
    def key(self) -> str:
        """Hash of everything that the runs' numbers depend on: scenario, map, format of the
        records, and the library's source."""
        parts = {
            "isogal": isogal.__version__,
            "code": source_digest(),
            "format": FORMAT,
            # what is promised of the errors does not change them
            "scenario": self.scenario.model_dump(mode="json", exclude={"integrity"}),
            "map": map_digest(self.field_map),
            "aided": self.aided,
        }
        each = self.scenario.each_field
        if any("map" in one.truth for one in each):
            route = build_trajectory(self.scenario)
            sources = [
                map_digest(true_map(one, route, its_map))
                for one, its_map in zip(each, each_map(self.field_map), strict=True)
            ]
            parts["true map"] = sources[0] if len(sources) == 1 else sources
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:24]


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """Some runs of a case, as they are sent to a worker; the map is sent separately."""

    case: str
    key: str
    map_key: str
    scenario: Scenario
    aided: bool
    runs: tuple[int, ...]
    duration: float
    """Simulated time of each run, s."""

    def text(self) -> str:
        """Return which runs these are, for messages."""
        first, last = self.runs[0], self.runs[-1]
        return f"run {first}" if first == last else f"runs {first} to {last}"


class Unaided:
    """A matcher that never gives a fix."""

    name = "unaided"
    context = 0
    takes_channels = True

    def match(self, batch: Batch, field_map: AnyMap, memory: Any) -> tuple[Fix, Any]:
        """Decline (see `isogal.matching.interfaces.Matcher`)."""
        return declined(batch, "unaided"), None


def compute(chunk: Chunk, field_map: RunMap, progress: Progress | None = None) -> Runs:
    """Compute the runs of a chunk; raises InputError where the scenario cannot be used."""
    return simulate(
        chunk.scenario, chunk.runs, field_map, None if chunk.aided else Unaided(), progress
    )


def divide(case: Case, missing: Sequence[int], share: int) -> list[Chunk]:
    """Cut the missing runs of a case into chunks of at most `share` runs (see `fair_share`) that
    fit into memory."""
    size = min(share, fitting(case.scenario, case.duration))
    key, map_key = case.key, map_digest(case.field_map)
    return [
        Chunk(
            case.name,
            key,
            map_key,
            case.scenario,
            case.aided,
            tuple(part[i : i + size]),
            case.duration,
        )
        for part in consecutive(missing)
        for i in range(0, len(part), size)
    ]


def fair_share(runs: int, workers: int) -> int:
    """Return how many of so many runs a chunk may have, so that all workers are busy to the
    end."""
    return min(MOST_RUNS, max(1, math.ceil(runs / (4 * workers))))


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


def consecutive(numbers: Iterable[int]) -> list[list[int]]:
    """Group increasing numbers into stretches without gaps."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and parts[-1][-1] + 1 == number:
            parts[-1].append(number)
        else:
            parts.append([number])
    return parts


@lru_cache(maxsize=1)
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


_DIGESTS: dict[int, tuple[RunMap, str]] = {}
"""By the id of the map. Maps do not change; they are kept here so that no other gets the same
id."""


def map_digest(field_map: RunMap) -> str:
    """Return a hash of a map's numbers, which identifies it to workers."""
    known = _DIGESTS.get(id(field_map))
    if known is None:
        digest = hashlib.sha256()
        for channel in (one for each in each_map(field_map) for one in channels_of(each)):
            for part in channel.parts():
                _digest(part, digest)
        known = _DIGESTS[id(field_map)] = (field_map, digest.hexdigest()[:16])
    return known[1]


def _digest(field_map: FieldMap, digest: Any) -> None:
    sigma = np.asarray(field_map.sigma)
    for array in (field_map.latitude, field_map.longitude, sigma, field_map.values):
        digest.update(f"{array.shape} {array.dtype}".encode())
        digest.update(np.ascontiguousarray(array).data)
    rest = (
        field_map.unit,
        field_map.quantity,
        field_map.correlation_length,
        field_map.quantisation,
    )
    digest.update(repr(rest).encode())
