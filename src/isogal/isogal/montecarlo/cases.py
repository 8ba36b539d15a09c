"""Cases to compute, and their runs, which workers compute one at a time."""

import hashlib
import json
import math
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np

import isogal
from isogal.evaluation.records import Runs
from isogal.fields.scenario_map import true_map
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.several import RunMap, each_map
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory


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
    def key(self) -> str:
        """Hash of everything that the runs' numbers depend on: scenario, map, recorded track and
        readings, and the library's source."""
        parts = {
            "code": source_digest(),
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
                map_digest(true_map(one.true, one.map, route, its_map))
                for one, its_map in zip(each, each_map(self.field_map), strict=True)
            ]
            parts["true map"] = sources[0] if len(sources) == 1 else sources
        recorded = [self.scenario.route.track, *(one.readings.source for one in each)]
        if files := sorted({Path(file) for file in recorded if file is not None}):
            parts["recorded"] = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:24]

    def compute(self, run: int) -> Runs:
        """Compute a run; raises InputError where the scenario cannot be used."""
        matcher = None if self.aided else Unaided()
        lag = math.inf if self.smooth else 0.0
        return simulate(self.scenario, [run], self.field_map, matcher, lag=lag)


@dataclass(frozen=True, eq=False)
class Job:
    """A run of a case, to be computed."""

    case: Case
    run: int

    def __str__(self) -> str:
        return f"{self.case.name}, run {self.run}"


class Unaided:
    """A matcher that never gives a fix."""

    name = "unaided"
    context = 0
    takes_channels = True

    def match(self, batch: Batch, field_map: AnyMap, memory: None) -> tuple[Fix, None]:
        """Decline (see `isogal.matching.interfaces.Matcher`)."""
        return declined(batch, "unaided"), None


@cache
def source_digest() -> str:
    """Return a hash of the source files, so that results of other source code are not taken for
    those of this one."""
    root = Path(isogal.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def map_digest(field_map: RunMap) -> str:
    """Return a hash of a map's numbers. Maps do not change."""
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
