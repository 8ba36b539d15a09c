"""How the paper's matcher goes from the navigator's track to its fix, iteration by iteration
(paper fig-64)."""

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import Batch, Candidates, Fix
from isogal.matching.paper.iteration import PaperOptions
from isogal.matching.paper.matcher import PmhtPaper
from isogal.montecarlo.engine import simulate
from isogal.paper.cases import Plan, Setting
from isogal.paper.published import FIGURE_64_SCAN, ITERATIONS
from isogal.sensors.trajectory import Trajectory, build_trajectory

Memory = TypeVar("Memory")


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One batch of T scans: positions in metres north and east of the true last scan."""

    time: float
    """s since the start, last scan."""
    states: Array
    """(I + 1, T, 2) m: the scans by the navigator, then after each iteration."""
    truth: Array
    """(T, 2) m."""
    candidates: Array
    """(N, 2) m."""
    weight: Array
    """(N,) in the last iteration."""

    @property
    def error(self) -> Array:
        """(I + 1,) m, of the last scan."""
        return np.hypot(self.states[:, -1, 0], self.states[:, -1, 1])

    @property
    def movement(self) -> Array:
        """(I,) m, RMS movement of the scans in each iteration."""
        return np.sqrt((np.diff(self.states, axis=0) ** 2).sum(axis=-1).mean(axis=-1))


@dataclass(frozen=True)
class BatchRecorder(PmhtPaper):
    """The paper's matcher, which keeps the batches that it is given."""

    batches: list[Batch] = field(default_factory=list)

    def match(
        self, batch: Batch, field_map: AnyMap, memory: float | None
    ) -> tuple[Fix, float | None]:
        """Match (see `isogal.matching.interfaces.Matcher`)."""
        self.batches.append(batch)
        return super().match(batch, field_map, memory)


def follow_iterations(plan: Plan) -> list[Snapshot]:
    """Return every batch of run 0 that gives a fix, up to the paper's snapshot (T = 15, low noise,
    gravity)."""
    setting = Setting(batch_length=15)
    field_map = plan.field_map(setting)
    scenario = Plan(1, plan.map_path, min(FIGURE_64_SCAN, plan.duration)).scenario(setting)
    recorder = BatchRecorder()
    simulate(scenario, [0], field_map, recorder)
    trajectory = build_trajectory(scenario)
    snapshots = [_follow(batch, field_map, trajectory) for batch in recorder.batches]
    return [snapshot for snapshot in snapshots if snapshot is not None]


def _follow(batch: Batch, field_map: AnyMap, trajectory: Trajectory) -> Snapshot | None:
    """Match a batch with one iteration, two, and so on; None where it gives no fix."""
    fixes, memory = [], None  # of the map's mean variability, computed once
    for count in range(1, ITERATIONS + 1):
        matcher = PmhtPaper(PaperOptions(iterations=count))
        fix, memory = matcher.match(batch, field_map, memory)
        if fix.scan_position is None:
            return None
        fixes.append(fix.scan_position)
    nothing = np.empty(0)
    candidates = fix.candidates or Candidates(nothing, nothing, nothing, np.empty(0, np.int64))
    latitude = np.interp(batch.time, trajectory.time, trajectory.latitude)
    longitude = np.interp(batch.time, trajectory.time, trajectory.longitude)
    metres = np.array([float(m) for m in metres_per_radian(latitude[-1])])

    def offset(there: Array) -> Array:
        return (there - [latitude[-1], longitude[-1]]) * metres

    start = np.stack([batch.latitude, batch.longitude], axis=-1)
    return Snapshot(
        time=float(batch.time[-1]),
        states=offset(np.stack([start, *fixes])),
        truth=offset(np.stack([latitude, longitude], axis=-1)),
        candidates=offset(np.stack([candidates.latitude, candidates.longitude], axis=-1)),
        weight=candidates.weight,
    )
