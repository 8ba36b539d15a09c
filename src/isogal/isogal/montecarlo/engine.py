"""Runs of a scenario in closed loop: simulate, navigate, match, aid (`isogal.navigator`).

A run's numbers depend on the scenario's seed and its own index only, not on which other runs are
computed with it."""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.fields.gravity_vector import sensed_gravity
from isogal.fields.known_gravity import known_gravity
from isogal.fields.scenario_map import maps_for_scenario, true_map
from isogal.fields.simulator import ReadingSimulator, compensated
from isogal.fusion.inertial_navigator import track_row
from isogal.fusion.measurements import Measurement, reading_of
from isogal.inertial.error_state import Estimate
from isogal.inertial.inverse import inverse
from isogal.maps.channels import RouteMap
from isogal.maps.several import RunMap, each_map, first_map
from isogal.matching.batching import fix_due
from isogal.matching.interfaces import Matcher
from isogal.matching.registry import build_run_matcher, leading_field
from isogal.montecarlo.recorder import Recorder
from isogal.navigator import Navigator
from isogal.scenario import Scenario
from isogal.sensors.barometer import simulate_heights
from isogal.sensors.imu import ImuData, simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.ins_solution import said, unaided_solution
from isogal.sensors.simulated_aids import simulate_aids
from isogal.sensors.trajectory import Trajectory, build_trajectory

Finished = Callable[[int, Navigator], None]
"""Called with a run's place in the list of runs, and its navigator at the end, with its whole
history."""
Arrivals = dict[int, list[tuple[float, Measurement]]]
"""Measurements, each with its time (s), by the number of IMU intervals before they come."""


def simulate(
    scenario: Scenario,
    runs: Sequence[int],
    field_map: RunMap | None = None,
    matcher: Matcher | None = None,
    *,
    lag: float = 0.0,
    finished: Finished | None = None,
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
    lag : float
        Record besides what all data until so much later say of each state, s; infinite = all data
        of the run, 0 = nothing.
    finished : callable, optional
        Called with each navigator at the end of its run, with its whole history as later fixes
        have left it; the record has the estimates of the time.

    Raises
    ------
    InputError
        There are no runs, or the scenario, its map or its matcher cannot be used.
    """
    if len(runs) == 0:
        raise InputError("a study needs at least one run")
    trajectory = build_trajectory(scenario)
    field_map = field_map or maps_for_scenario(scenario, trajectory)
    matcher = matcher or build_run_matcher(scenario)
    whole = finished is not None
    simulation = Simulation(scenario, runs, trajectory, field_map, lag=lag, whole=whole)
    recorder = Recorder(trajectory, simulation.index, simulation.ends, len(runs), lag > 0.0)
    for run in range(len(runs)):
        navigator = _navigated(simulation, run, matcher, recorder)
        if finished is not None:
            finished(run, navigator)
    return recorder.record(simulation.unaided, first_map(field_map))


def _navigated(
    simulation: "Simulation", run: int, matcher: Matcher, recorder: Recorder
) -> Navigator:
    """Navigate a run, by its place, from start to end, and record it; return its navigator."""
    navigator, time = simulation.navigator(run, matcher), simulation.time
    recorder.write_track(run, 0, navigator.inertial.track(time[:1]))
    aids, smoothed = simulation.measurements(run), 0
    stops = sorted({0, *simulation.ends.tolist(), simulation.scans})
    for batch, (before, scan) in enumerate(pairwise(stops)):
        for begin, end in pairwise(range(before, scan + 1, simulation.at_once(before, scan))):
            simulation.advance(navigator, run, begin, end, aids)
            track = navigator.inertial.track(time[begin + 1 : end + 1])
            recorder.write_track(run, begin + 1, track)
            simulation.read(navigator, run, begin, end, recorder)
        applied = navigator.fix()
        if applied is not None:
            recorder.write_fix(run, batch, applied)
            recorder.write_track(run, scan, track_row(navigator.state)[None])
        if simulation.lag > 0.0:  # states that are a lag old, at the end all that are left
            old = np.searchsorted(time, navigator.time - simulation.lag + 1e-6)
            last = len(time) if scan == simulation.scans else int(old)
            if last > smoothed:
                recorder.write_smoothed(run, smoothed, navigator.smoothed(time[smoothed:last]))
                smoothed = last
    return navigator


class Simulation:
    """What is simulated of R runs, and how it reaches their navigators."""

    def __init__(
        self,
        scenario: Scenario,
        runs: Sequence[int],
        trajectory: Trajectory,
        field_map: RunMap,
        *,
        lag: float = 0.0,
        whole: bool = False,
    ) -> None:
        self.scenario, self.trajectory, self.runs = scenario, trajectory, runs
        self.lag, self._whole = lag, whole
        self.index = np.arange(0, len(trajectory) + 1, scenario.steps_per_scan)
        """IMU intervals before each state that is recorded: the start, then each scan."""
        self.scans = len(self.index) - 1
        self.time = trajectory.time[self.index]
        """(S + 1,) s, of these states."""
        truth = scenario.true
        self._delay = max((one.delay for one in truth.aids), default=0.0)
        """By how much measurements may come late, s."""
        self._known = known_gravity(scenario.gravity_field, trajectory)
        sensed = sensed_gravity(truth.gravity_field, trajectory, runs)
        self._imu = simulate_imu(truth, trajectory, runs, sensed)
        preintegrated = truth.samples_per_step > 1
        start = draw_initial_state(truth.initial_error, trajectory, truth.seed, runs)
        given = truth.ins.gives_solution
        compensation = None if given else self._known.compensation
        ins = unaided_solution(start, trajectory, self._imu, preintegrated, compensation)
        if given:
            ins = said(truth.ins, ins)
            self._imu = ImuData(*inverse(ins, trajectory.dt, preintegrated))
            start = Estimate(*np.split(ins[:, 0], [3, 6], axis=1))
        latitude, longitude = (ins[:, self.index, axis] for axis in range(2))
        truth_at = trajectory.latitude[self.index], trajectory.longitude[self.index]
        self.unaided = horizontal_difference(latitude, longitude, *truth_at)
        """(R, S + 1, 2) m, error of the unaided navigators north and east at these states."""
        self._start = start
        self._fields, self._maps = scenario.each_field, each_map(field_map)
        self._every = [one.steps_per_scan // scenario.steps_per_scan for one in self._fields]
        """Scans of the record from one of each field to the next."""
        self.ends = self._batch_ends()
        """The scans at which a batch ends."""
        found = [
            _readings(one, trajectory, its_map, runs)
            for one, its_map in zip(self._fields, self._maps, strict=True)
        ]
        self._reading_times, self._readings = zip(*found, strict=True)
        self._aids = tuple(
            zip(scenario.aids, truth.aids, simulate_aids(truth, trajectory, runs), strict=True)
        )
        """Each aid as assumed and as it is, and its readings."""
        self._heights = np.broadcast_to(trajectory.height[1:], (len(runs), len(trajectory)))
        if truth.height.measured:
            ends, values = simulate_heights(truth.height, trajectory, truth.seed, runs)
            self._heights = np.full(self._heights.shape, np.nan)
            self._heights[:, ends - 1] = values

    def _batch_ends(self) -> Integers:
        """Return the scans at which a batch ends."""
        lead = leading_field(self._fields)
        every, settings = self._every[lead], self._fields[lead].matcher
        scans = range(every, self.scans + 1, every)
        ends = [scan for scan in scans if fix_due(scan // every, settings)]
        return np.array(ends, dtype=np.int64)

    def navigator(self, run: int, matcher: Matcher) -> Navigator:
        """Return the navigator of a run, by its place, at its start."""
        start, begin = self._start, float(self.trajectory.time[0])
        estimate = Estimate(start.position[run], start.velocity[run], start.attitude[run])
        # of a batch, and what comes later still
        longest = np.diff(self.time[[0, *self.ends, self.scans]]).max() + self._delay
        return Navigator(
            self.scenario,
            self._maps,
            estimate,
            begin,
            gravity=self._known,
            matcher=matcher,
            horizon=math.inf if self._whole else self.lag + float(longest),
        )

    def measurements(self, run: int) -> Arrivals:
        """Return the readings of aids, with their times (s), by the number of IMU intervals before
        they come; those of the height come with the inertial data."""
        found: Arrivals = defaultdict(list)
        time, rates = self.trajectory.time, self._imu.angular_rate[run]
        for aid, true, read in self._aids:
            late = math.ceil(true.delay / self.trajectory.dt - 1e-9)
            for k, value in zip(read.ends.tolist(), read.values[run], strict=True):
                one = reading_of(aid, value, self.scenario, rates[k - 1])
                if one is not None and k + late <= len(self.trajectory):
                    found[k + late].append((float(time[k]), one))
        return dict(found)

    def at_once(self, before: int, scan: int) -> int:
        """Return how many scans may be dealt with at once: all from one to another, or one where
        measurements come late, which change the state of a scan after its reading has been taken.
        """
        aligns = self.scenario.fusion.start == "align"  # that it was at rest is confirmed late
        return 1 if aligns or self._delay > 0.0 else scan - before

    def advance(
        self, navigator: Navigator, run: int, before: int, scan: int, aids: Arrivals
    ) -> None:
        """Advance the navigator of a run from one scan to another."""
        first, last = self.index[[before, scan]].tolist()
        stops = [k for k in range(first + 1, last) if k in aids]
        for begin, end in pairwise([first, *stops, last]):
            stamps = self.trajectory.time[begin + 1 : end + 1]
            navigator.imu(stamps, *self.samples(run, begin, end))
            for time, one in aids.get(end, ()):
                navigator.measure(time, one)

    def samples(self, run: int, first: int, last: int) -> tuple[Array, Array, Array]:
        """Return specific force (S, 3), angular rate (S, 3) and height (S,), known or measured, of
        some IMU intervals."""
        part, imu = slice(first, last), self._imu
        return imu.specific_force[run, part], imu.angular_rate[run, part], self._heights[run, part]

    def sensed(self, field: int, run: int, scans: Integers) -> Array:
        """Return (K,) or (K, C) what the instrument of a field senses at scans of its own, counted
        from 1."""
        return np.asarray(self._readings[field][run, scans - 1])

    def read(
        self,
        navigator: Navigator,
        run: int,
        before: int,
        scan: int,
        recorder: Recorder | None = None,
    ) -> None:
        """Give the navigator of a run the readings after one scan and up to another."""
        for field, every in enumerate(self._every):
            scans = np.arange(before // every + 1, scan // every + 1) * every
            if len(scans) == 0:
                continue
            sensed = self.sensed(field, run, scans // every)
            time = self._reading_times[field][scans // every - 1]
            reduced = navigator.read(field, time, sensed)
            if recorder is not None and field == 0 and run == 0:
                seen = navigator.inertial.track(time)
                recorder.write_readings(scans - 1, reduced, seen)


def _readings(
    scenario: Scenario, trajectory: Trajectory, field_map: RouteMap, runs: Sequence[int]
) -> tuple[Array, Array]:
    """Return (S,) when the instrument of a field takes its readings, s, and (R, S) or (R, S, C)
    what it senses."""
    truth = scenario.true
    source = true_map(truth, scenario.map, trajectory, field_map)
    simulated = ReadingSimulator(truth, trajectory, source, runs)
    return simulated.time, compensated(scenario, trajectory, simulated)
