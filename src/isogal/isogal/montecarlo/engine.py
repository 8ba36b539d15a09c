"""Runs of a scenario in closed loop: simulate, navigate, match, aid. The same functions as the
nodes, with a run axis.

Every run goes through the full strapdown and the full unscented filter at the IMU's rate. A run's
numbers depend on the scenario's seed and its own index only, never on which other runs are
computed beside it."""

import time as clock
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.records import RunDetail, Runs
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulator import ReadingSimulator
from isogal.fusion.navigator import (
    FilterModel,
    FilterState,
    jump_between,
    propagate,
    update_information,
    update_position,
    widen,
)
from isogal.inertial.strapdown import propagate as propagate_ins
from isogal.maps.channels import AnyMap, channels_of
from isogal.matching.batching import BatchBuilder, fix_due
from isogal.matching.interfaces import LOST_SIGMA, Candidates, Fix, Matcher
from isogal.matching.registry import build_matcher
from isogal.scenario import Scenario
from isogal.sensors.imu import ImuData, simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import Trajectory, build_trajectory

Progress = Callable[[float], None]
"""Called with the simulated time (s) after each scan."""
Revised = Callable[[int, list[int], FilterState], None]
"""Called by retrodiction with the index of a past state, which of the runs were changed there, and
what they are there now."""


def simulate_unaided(
    scenario: Scenario, runs: Sequence[int], trajectory: Trajectory, imu: ImuData | None = None
) -> Array:
    """Return (R, K, 2) the unaided INS's north and east error (m) at the start and at every
    scan."""
    imu = imu or simulate_imu(scenario, trajectory, runs)
    start = draw_initial_state(scenario, trajectory, runs)
    _, track = propagate_ins(
        start, imu.specific_force, imu.angular_rate, trajectory.dt, trajectory.height, history=True
    )
    stride = scenario.steps_per_scan
    index = np.arange(0, len(trajectory) + 1, stride)
    latitude = np.concatenate([start.position[:, :1], track[:, stride - 1 :: stride, 0]], axis=1)
    longitude = np.concatenate([start.position[:, 1:2], track[:, stride - 1 :: stride, 1]], axis=1)
    return horizontal_difference(
        latitude, longitude, trajectory.latitude[index], trajectory.longitude[index]
    )


def simulate(
    scenario: Scenario,
    runs: Sequence[int],
    field_map: AnyMap | None = None,
    matcher: Matcher | None = None,
    progress: Progress | None = None,
    revised: Revised | None = None,
) -> Runs:
    """Run the closed loop and return what it leaves behind, at the start and at every scan.

    Parameters
    ----------
    scenario : Scenario
    runs : sequence of int
        Indices of the runs; they seed the random streams.
    field_map : FieldMap or ChannelMap, optional
        Default: the scenario's.
    matcher : Matcher, optional
        Default: the scenario's.
    progress : callable, optional
    revised : callable, optional
        Told of past states that retrodiction corrects; the record keeps what the navigator said at
        the time.

    Raises
    ------
    InputError
        The scenario, its map or its matcher cannot be used.
    """
    trajectory = build_trajectory(scenario)
    field_map = field_map or map_for_scenario(scenario, trajectory)
    matcher = matcher or build_matcher(
        scenario.matcher, measured_field(scenario).channels is not None
    )
    loop = _ClosedLoop(scenario, runs, trajectory, field_map, matcher, revised)
    for scan in range(loop.scans):
        loop.advance(scan)
        if progress is not None:
            progress(float(trajectory.time[loop.index[scan + 1]]))
    return loop.record()


class _ClosedLoop:
    """State of R navigators, their batches and their matchers' memories."""

    def __init__(
        self,
        scenario: Scenario,
        runs: Sequence[int],
        trajectory: Trajectory,
        field_map: AnyMap,
        matcher: Matcher,
        revised: Revised | None,
    ) -> None:
        self.scenario, self.trajectory, self.field_map, self.matcher = (
            scenario,
            trajectory,
            field_map,
            matcher,
        )
        self.revised = revised
        self.runs = list(runs)
        self.stride = scenario.steps_per_scan
        self.index = np.arange(0, len(trajectory) + 1, self.stride)
        self.scans = len(self.index) - 1
        self.imu = simulate_imu(scenario, trajectory, runs)
        self.unaided = simulate_unaided(scenario, runs, trajectory, self.imu)
        self.felt = ReadingSimulator(scenario, trajectory, field_map, runs).felt
        self.model = FilterModel.from_scenario(scenario)
        self.state = FilterState.start(draw_initial_state(scenario, trajectory, runs), self.model)
        field = measured_field(scenario)
        self.reduction, covariance = field.reduction(scenario), field.covariance(scenario)
        context = matcher.context
        self.builders = [
            BatchBuilder(scenario.matcher, self.reduction, context, covariance) for _ in runs
        ]
        self.memories: list[Any] = [None for _ in runs]
        self.anchor = (self.state.copy(), 0)  # states at the last batch end, for retrodiction
        self.due = [scan for scan in range(self.scans) if fix_due(scan + 1, scenario.matcher)]
        count, batches = len(self.runs), len(self.due)
        self.error = np.full((count, self.scans + 1, 2), np.nan)
        self.covariance = np.full((count, self.scans + 1, 2, 2), np.nan)
        self.fix_error = np.full((count, batches, 2), np.nan)
        self.fix_covariance = np.full((count, batches, 2, 2), np.nan)
        self.posterior_error = np.full((count, batches, 2), np.nan)
        self.posterior_covariance = np.full((count, batches, 2, 2), np.nan)
        self.seconds = np.zeros((count, batches))
        self.reasons: list[list[str | None]] = [[] for _ in runs]
        self.candidates: list[Candidates | None] = []
        self.variability = np.full(self.scans, np.nan)
        self.reading = np.full(self.scans, np.nan)
        self.seen = np.full((self.scans, 2), np.nan)
        self._write(0)

    def advance(self, scan: int) -> None:
        """Propagate to the end of a scan's interval, take the reading, and match where a batch is
        due."""
        first, last = self.index[scan], self.index[scan + 1]
        self._propagate(self.state, slice(None), first, last)
        self._read(scan)
        if scan in self.due:
            batch = self.due.index(scan)
            fixes = [self._match(run, batch) for run in range(len(self.runs))]
            before = self.state.copy()
            self._aid(fixes, scan)
            for run in range(len(self.runs)):
                self._correct(run, before, float(self.trajectory.time[last]))
            self.anchor = (self.state.copy(), int(last))
        self._write(scan + 1)
        if scan in self.due:
            self.posterior_error[:, batch] = self.error[:, scan + 1]
            self.posterior_covariance[:, batch] = self.covariance[:, scan + 1]

    def _propagate(self, state: FilterState, which: Any, first: int, last: int) -> None:
        propagate(
            state,
            self.model,
            self.imu.specific_force[which, first:last],
            self.imu.angular_rate[which, first:last],
            self.trajectory.height[first + 1 : last + 1],
        )

    def _read(self, scan: int) -> None:
        position, velocity = self.state.position, self.state.velocity
        estimate = State(
            position[:, 0], position[:, 1], position[:, 2], velocity[:, 0], velocity[:, 1]
        )
        reading = self.reduction.reduce(self.felt[:, scan], estimate)
        time = float(self.trajectory.time[self.index[scan + 1]])
        for run, builder in enumerate(self.builders):
            builder.add_scan(
                time,
                position[run, 0],
                position[run, 1],
                velocity[run, :2],
                reading[run],
                self.scenario.gravimeter.sigma,
            )
        self.reading[scan] = reading[0].flat[0]  # figures show the first channel
        self.seen[scan] = position[0, :2]

    def _match(self, run: int, batch: int) -> Fix:
        task = self.builders[run].build(self.state.batch_prior[run])
        start = clock.perf_counter()
        fix, self.memories[run] = self.matcher.match(task, self.field_map, self.memories[run])
        self.seconds[run, batch] = clock.perf_counter() - start
        self.reasons[run].append(fix.reason)
        if fix.published:
            end = self.index[self.due[batch] + 1]
            truth = self.trajectory.latitude[end], self.trajectory.longitude[end]
            self.fix_error[run, batch] = horizontal_difference(fix.latitude, fix.longitude, *truth)
            self.fix_covariance[run, batch] = fix.covariance
        if run == 0:
            self.candidates.append(fix.candidates)
            self.variability[self.due[batch]] = fix.diagnostics.get("feature_variability", np.nan)
        return fix

    def _aid(self, fixes: list[Fix], scan: int) -> None:
        retrodict = self.scenario.matcher.mode == "retrodiction"
        late = [
            run
            for run, fix in enumerate(fixes)
            if fix.published and retrodict and fix.scan_position is not None
        ]
        for run, fix in enumerate(fixes):
            if fix.reset:
                widen(self.state, run, LOST_SIGMA)
            if not fix.published or run in late:
                continue
            if fix.information is not None:
                update_information(self.state, run, fix.information.vector, fix.information.matrix)
            else:
                update_position(self.state, run, fix.latitude, fix.longitude, fix.covariance)
        if late:
            self._retrodict(late, fixes, scan)

    def _retrodict(self, late: list[int], fixes: list[Fix], scan: int) -> None:
        """Go back to the last batch end and take each scan's fix where it belongs."""
        state, start = self.anchor
        part = FilterState(*(array[late].copy() for array in state.arrays()))
        first_scan = int(np.searchsorted(self.index, start))
        for step in range(first_scan, scan + 1):
            self._propagate(part, late, self.index[step], self.index[step + 1])
            for row, run in enumerate(late):
                positions, covariances = fixes[run].scan_position, fixes[run].scan_covariance
                assert positions is not None and covariances is not None
                i = len(positions) - 1 - (scan - step)
                if i >= 0 and np.isfinite(covariances[i]).all():
                    update_position(part, row, positions[i, 0], positions[i, 1], covariances[i])
            if self.revised is not None:
                self.revised(step + 1, late, part)
        for target, source in zip(self.state.arrays(), part.arrays(), strict=True):
            target[late] = source

    def _correct(self, run: int, before: FilterState, time: float) -> None:
        jump = jump_between(before, self.state, run)
        if jump.any():
            self.builders[run].correct(time, jump)

    def _write(self, k: int) -> None:
        truth = self.trajectory.latitude[self.index[k]], self.trajectory.longitude[self.index[k]]
        self.error[:, k] = horizontal_difference(
            self.state.position[:, 0], self.state.position[:, 1], *truth
        )
        self.covariance[:, k] = self.state.covariance[:, :2, :2]

    def record(self) -> Runs:
        """Return what the runs left behind."""
        at = self.index
        latitude, longitude = self.trajectory.latitude[at], self.trajectory.longitude[at]
        ends = at[np.array(self.due, dtype=np.int64) + 1]
        shown = channels_of(self.field_map)[0]
        detail = RunDetail(
            scan_time=self.trajectory.time[at[1:]],
            reading=self.reading,
            map_value=shown.value(latitude[1:], longitude[1:]),
            map_value_navigator=shown.value(self.seen[:, 0], self.seen[:, 1]),
            feature_variability=self.variability,
            **RunDetail.flatten(self.candidates),
        )
        return Runs(
            time=self.trajectory.time[at],
            latitude=latitude,
            longitude=longitude,
            error=self.error,
            covariance=self.covariance,
            unaided_error=self.unaided,
            fix_time=self.trajectory.time[ends],
            fix_error=self.fix_error,
            fix_covariance=self.fix_covariance,
            fix_reason=tuple(tuple(reasons) for reasons in self.reasons),
            posterior_error=self.posterior_error,
            posterior_covariance=self.posterior_covariance,
            fix_seconds=self.seconds,
            detail=detail,
        )
