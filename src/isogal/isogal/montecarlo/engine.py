"""Runs of a scenario in closed loop: simulate, navigate, match, aid. The functions are those that
the nodes call, with a run axis.

Every run goes through the full strapdown and the full unscented filter at the IMU's rate. A run's
numbers depend on the scenario's seed and its own index only, not on which other runs are computed
with it."""

import time as clock
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.records import Runs
from isogal.fields.gravity_vector import felt_gravity
from isogal.fields.known_gravity import known_gravity
from isogal.fields.scenario_map import maps_for_scenario
from isogal.fix import apply_fix
from isogal.fusion.gate import RejectedError
from isogal.fusion.model import FilterModel
from isogal.fusion.navigator import NavigatorRun
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import batch_difference
from isogal.inertial.gravity import Compensation
from isogal.inertial.strapdown import propagate as propagate_ins
from isogal.maps.several import RunMap, each_map, first_map
from isogal.matching.batching import fix_due
from isogal.matching.failures import match_or_decline
from isogal.matching.interfaces import Batch, Fix, Matcher
from isogal.matching.joint_batches import JointBatches
from isogal.matching.registry import build_run_matcher
from isogal.matching.several import Rhythm
from isogal.montecarlo.aids import Aids
from isogal.montecarlo.field_runs import FieldRuns
from isogal.montecarlo.recorder import Recorder
from isogal.scenario import Scenario, Truth
from isogal.sensors.imu import ImuData, simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import Trajectory, build_trajectory

Progress = Callable[[float], None]
"""Called with the simulated time (s) after each scan."""
Revised = Callable[[int, list[int], FilterState], None]
"""Called by retrodiction with the index of a past state, the runs that were changed there, and
their states."""


def simulate_unaided(
    truth: Truth,
    runs: Sequence[int],
    trajectory: Trajectory,
    imu: ImuData,
    compensation: Compensation | None = None,
) -> Array:
    """Return (R, K, 2) the unaided INS's north and east error (m) at the start and at every
    scan."""
    start = draw_initial_state(truth, trajectory, runs)
    _, track = propagate_ins(
        start,
        imu.specific_force,
        imu.angular_rate,
        trajectory.dt,
        trajectory.height,
        compensation,
        history=True,
        preintegrated=truth.samples_per_step > 1,
    )
    stride = truth.steps_per_scan
    index = np.arange(0, len(trajectory) + 1, stride)
    latitude = np.concatenate([start.position[:, :1], track[:, stride - 1 :: stride, 0]], axis=1)
    longitude = np.concatenate([start.position[:, 1:2], track[:, stride - 1 :: stride, 1]], axis=1)
    return horizontal_difference(
        latitude, longitude, trajectory.latitude[index], trajectory.longitude[index]
    )


def simulate(
    scenario: Scenario,
    runs: Sequence[int],
    field_map: RunMap | None = None,
    matcher: Matcher | None = None,
    progress: Progress | None = None,
    revised: Revised | None = None,
) -> Runs:
    """Run the closed loop and return its record, at the start and at every scan.

    Parameters
    ----------
    scenario : Scenario
    runs : sequence of int
        Indices of the runs; they seed the random streams.
    field_map : FieldMap, TiledMap or ChannelMap, or FieldMaps of several fields, optional
        Default: the scenario's.
    matcher : Matcher, optional
        Default: the scenario's.
    progress : callable, optional
    revised : callable, optional
        Called with past states that retrodiction corrects; the record keeps the navigator's
        estimates of the time.

    Raises
    ------
    InputError
        The scenario, its map or its matcher cannot be used.
    """
    trajectory = build_trajectory(scenario)
    field_map = field_map or maps_for_scenario(scenario, trajectory)
    matcher = matcher or build_run_matcher(scenario)
    loop = _ClosedLoop(scenario, runs, trajectory, field_map, matcher, revised)
    for scan in range(1, loop.scans + 1):
        loop.advance(scan)
        if progress is not None:
            progress(float(trajectory.time[loop.index[scan]]))
    return loop.record()


class _ClosedLoop:
    """R navigators, their batches and what their matchers remember."""

    def __init__(
        self,
        scenario: Scenario,
        runs: Sequence[int],
        trajectory: Trajectory,
        field_map: RunMap,
        matcher: Matcher,
        revised: Revised | None,
    ) -> None:
        self.scenario, self.trajectory = scenario, trajectory
        self.field_map, self.matcher, self.revised = field_map, matcher, revised
        self.index = np.arange(0, len(trajectory) + 1, scenario.steps_per_scan)
        self.scans = len(self.index) - 1
        truth, of_gravity = scenario.true, scenario.felt_field
        known = known_gravity(of_gravity, trajectory)
        felt = felt_gravity(of_gravity.true, trajectory, runs)
        self.imu = simulate_imu(truth, trajectory, runs, felt)
        self.unaided = simulate_unaided(truth, runs, trajectory, self.imu, known.compensation)
        each = scenario.each_field
        own = scenario.steps_per_scan
        self.fields = [
            FieldRuns(one, trajectory, its_map, runs, one.steps_per_scan // own)
            for one, its_map in zip(each, each_map(field_map), strict=True)
        ]
        self.model = FilterModel.from_scenario(scenario, known)
        self.aids = Aids(scenario, trajectory, runs, self.model, self.imu)
        self.state = FilterState.start(draw_initial_state(truth, trajectory, runs), self.model)
        self.anchor = (self.state.copy(), 0)
        """The navigators at the last batch end, and its scan, for retrodiction."""
        self.lead = Rhythm.of(each).lead
        self.batches = [JointBatches.of(scenario, matcher, known) for _ in runs]
        self.memories: list[Any] = [None for _ in runs]
        due = self._due()
        self.batch_at = {scan: batch for batch, scan in enumerate(due)}
        ends = np.array(due, dtype=np.int64)
        self.recorder = Recorder(trajectory, self.index, ends, len(self.batches))
        self.recorder.write_state(0, self.state)

    def advance(self, scan: int) -> None:
        """Propagate to a scan (counted from 1), take the reading, and match where a batch ends."""
        self._propagate(self.state, slice(None), scan)
        self._read(scan)
        if scan in self.batch_at:
            before = self.state.copy()
            batch = self.batch_at[scan]
            self._aid([self._match(run, batch) for run in range(len(self.batches))], scan)
            self._correct_batches(before, scan)
            self.anchor = (self.state.copy(), scan)
        self.recorder.write_state(scan, self.state)

    def record(self) -> Runs:
        """Return the record of the runs."""
        return self.recorder.record(self.unaided, first_map(self.field_map))

    def _due(self) -> list[int]:
        """Return the scans at which a batch ends."""
        lead = self.fields[self.lead].scenario
        every = lead.steps_per_scan // self.scenario.steps_per_scan
        return [
            scan
            for scan in range(every, self.scans + 1, every)
            if fix_due(scan // every, lead.matcher)
        ]

    def _propagate(self, state: FilterState, which: Any, scan: int) -> None:
        """Advance some of the runs from the scan before to this one."""
        self.aids.advance(state, which, int(self.index[scan - 1]), int(self.index[scan]))

    def _read(self, scan: int) -> None:
        position, velocity = self.state.position, self.state.velocity
        for k, field in enumerate(self.fields):
            reading = field.reduced(scan, self.state)
            if reading is None:
                continue
            for run, batches in enumerate(self.batches):
                batches.builders[k].add_scan(
                    self._time(scan),
                    position[run, 0],
                    position[run, 1],
                    velocity[run, :2],
                    reading[run],
                    field.scenario.gravimeter.sigma,
                    height=position[run, 2],
                )
            if k == 0:
                self.recorder.write_reading(scan - 1, reading, self.state)

    def _match(self, run: int, batch: int) -> Fix:
        task = self.batches[run].build(self.state.batch_prior[run], self._near)
        start = clock.perf_counter()
        near = self._near(self.lead, task)
        memory = self.memories[run]
        fix, self.memories[run] = match_or_decline(self.matcher, task, near, memory)
        self.recorder.write_fix(run, batch, fix, clock.perf_counter() - start)
        self.batches[run].learn(fix)
        return fix

    def _near(self, field: int, batch: Batch) -> Any:
        """Return the map of a field around a batch."""
        return self.fields[field].field_map.near(batch.latitude, batch.longitude)

    def _aid(self, fixes: list[Fix], scan: int) -> None:
        """Apply the fixes of all runs: at the batch end, or in retrodiction those of each scan
        where it was, if the matcher gives them."""
        each_scan = [
            run
            for run, fix in enumerate(fixes)
            if self.scenario.matcher.mode == "retrodiction"
            and fix.published
            and fix.widening is None
            and fix.scan_position is not None
        ]
        for run, fix in enumerate(fixes):
            if run not in each_scan:
                self._apply(fix, self.state, run, run)
        if each_scan:
            self._retrodict(each_scan, fixes, scan)

    def _apply(self, fix: Fix, state: FilterState, row: int, run: int) -> None:
        """Apply a fix of a run, which is a row of the state."""
        try:
            apply_fix(fix, NavigatorRun(state, self.model, row))
        except RejectedError as error:
            self.recorder.write_rejection(run, str(error))

    def _retrodict(self, runs: list[int], fixes: list[Fix], scan: int) -> None:
        """Go back to the last batch end and take each scan's fix where it belongs."""
        state, start = self.anchor
        part = FilterState(*(array[runs].copy() for array in state.arrays()))
        for past in range(start + 1, scan + 1):
            self._propagate(part, runs, past)
            for row, run in enumerate(runs):
                fix = fixes[run]
                count = 0 if fix.scan_position is None else len(fix.scan_position)
                share = fix.of_scan(count - 1 - (scan - past))
                if share is not None:
                    self._apply(share, part, row, run)
            if self.revised is not None:
                self.revised(past, runs, part)
        for target, source in zip(self.state.arrays(), part.arrays(), strict=True):
            target[runs] = source

    def _correct_batches(self, before: FilterState, scan: int) -> None:
        """Carry what the fixes at a scan changed in the navigators back to their batches."""
        for run, batches in enumerate(self.batches):
            change = batch_difference(self.state.estimate_of(run), before.estimate_of(run))
            if change.any():
                batches.correct(self._time(scan), change)

    def _time(self, scan: int) -> float:
        return float(self.trajectory.time[self.index[scan]])
