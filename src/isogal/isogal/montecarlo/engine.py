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
from isogal.evaluation.records import Runs
from isogal.fields.gravity_vector import sensed_gravity
from isogal.fields.known_gravity import known_gravity
from isogal.fields.scenario_map import maps_for_scenario, true_map
from isogal.fields.simulator import ReadingSimulator, compensated
from isogal.fusion.inertial_navigator import track_row
from isogal.fusion.measurements import (
    Measurement,
    VelocityReading,
    satellite_fix,
    satellite_velocity,
)
from isogal.inertial.error_state import Estimate
from isogal.inertial.gravity import Compensation
from isogal.inertial.strapdown import propagate as propagate_ins
from isogal.maps.channels import RouteMap
from isogal.maps.several import RunMap, each_map, first_map
from isogal.matching.batching import fix_due
from isogal.matching.interfaces import Matcher
from isogal.matching.registry import build_run_matcher
from isogal.matching.update_schedule import UpdateSchedule
from isogal.montecarlo.recorder import Recorder
from isogal.navigator import Navigator
from isogal.scenario import Scenario, Truth
from isogal.sensors.barometer import simulate_heights
from isogal.sensors.imu import ImuData, simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.satellites import SatelliteFixes, simulate_satellites
from isogal.sensors.trajectory import Trajectory, build_trajectory
from isogal.sensors.velocity_aid import simulate_velocities

Progress = Callable[[float], None]
"""Called with the simulated time (s), on the mean of all runs, after each fix."""
Revised = Callable[[int, Integers, Array], None]
"""Called with a run's place in the list of runs, the indices of past states that retrodiction has
changed, and their track (`isogal.fusion.prediction.TRACK_COLUMNS`)."""
Arrivals = dict[int, list[tuple[float, Measurement]]]
"""Measurements, each with its time (s), by the number of IMU intervals before they come."""


def simulate_unaided(
    truth: Truth,
    runs: Sequence[int],
    trajectory: Trajectory,
    imu: ImuData,
    compensation: Compensation | None = None,
) -> Array:
    """Return (R, K, 2) the unaided INS's north and east error (m) at the start and at every
    scan.

    Parameters
    ----------
    truth : Truth
    runs : sequence of int
    trajectory : Trajectory
    imu : ImuData
    compensation : Compensation, optional
        Horizontal gravity that the strapdown takes off.
    """
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
    simulation = Simulation(scenario, runs, trajectory, field_map)
    ends = simulation.ends
    recorder = Recorder(trajectory, simulation.index, ends, len(runs))
    elapsed = trajectory.time[-1] - trajectory.time[0]
    stops = [0, *ends.tolist()]
    stops += [] if stops[-1] == simulation.scans else [simulation.scans]
    for run in range(len(runs)):
        navigator = simulation.navigator(run, matcher)
        recorder.write_track(run, 0, navigator.inertial.track(trajectory.time[:1]))
        aids = simulation.measurements(run)
        for batch, (before, scan) in enumerate(pairwise(stops)):
            for begin, end in pairwise(range(before, scan + 1, simulation.at_once(before, scan))):
                simulation.advance(navigator, run, begin, end, aids)
                recorder.write_track(run, begin + 1, simulation.track(navigator, begin, end))
                simulation.read(navigator, run, begin, end, recorder)
            applied = navigator.fix()
            if applied is not None:
                recorder.write_fix(run, batch, applied)
                recorder.write_track(run, scan, track_row(navigator.state)[None])
                if revised is not None and applied.innovations:
                    scans = np.arange(before + 1, scan + 1)
                    revised(run, scans, simulation.track(navigator, before, scan))
            if progress is not None:
                share = (run + scan / simulation.scans) / len(runs)
                progress(float(trajectory.time[0] + share * elapsed))
    return recorder.record(simulation.unaided, first_map(field_map))


class Simulation:
    """What is simulated of R runs, and how it reaches their navigators."""

    def __init__(
        self, scenario: Scenario, runs: Sequence[int], trajectory: Trajectory, field_map: RunMap
    ) -> None:
        self.scenario, self.trajectory, self.runs = scenario, trajectory, runs
        self.index = np.arange(0, len(trajectory) + 1, scenario.steps_per_scan)
        """IMU intervals before each state that is recorded: the start, then each scan."""
        self.scans = len(self.index) - 1
        truth, of_gravity = scenario.true, scenario.gravity_field
        self._known = known_gravity(of_gravity, trajectory)
        sensed = sensed_gravity(of_gravity.true, trajectory, runs)
        self._imu = simulate_imu(truth, trajectory, runs, sensed)
        compensation = self._known.compensation
        self.unaided = simulate_unaided(truth, runs, trajectory, self._imu, compensation)
        self._start = draw_initial_state(truth, trajectory, runs)
        self._fields, self._maps = scenario.each_field, each_map(field_map)
        self._every = [one.steps_per_scan // scenario.steps_per_scan for one in self._fields]
        """Scans of the record from one of each field to the next."""
        self.ends = self._batch_ends()
        """The scans at which a batch ends."""
        self._readings = [
            _readings(one, trajectory, its_map, runs)
            for one, its_map in zip(self._fields, self._maps, strict=True)
        ]
        self._heights = np.broadcast_to(trajectory.height[1:], (len(runs), len(trajectory)))
        if truth.height.measured:
            self._heights = simulate_heights(truth, trajectory, runs)
        self._velocities: Array | None = None
        if truth.velocity.kind != "none":
            self._velocities = simulate_velocities(truth, trajectory, runs)
        self._satellites: SatelliteFixes | None = None
        if truth.gnss.used:
            self._satellites = simulate_satellites(truth, trajectory, runs)

    def _batch_ends(self) -> Integers:
        """Return the scans at which a batch ends."""
        lead = UpdateSchedule.of(self._fields).lead
        every, settings = self._every[lead], self._fields[lead].matcher
        scans = range(every, self.scans + 1, every)
        ends = [scan for scan in scans if fix_due(scan // every, settings)]
        return np.array(ends, dtype=np.int64)

    def navigator(self, run: int, matcher: Matcher) -> Navigator:
        """Return the navigator of a run, by its place, at its start."""
        start, begin = self._start, float(self.trajectory.time[0])
        estimate = Estimate(start.position[run], start.velocity[run], start.attitude[run])
        return Navigator(
            self.scenario,
            self._maps,
            estimate,
            begin,
            gravity=self._known,
            matcher=matcher,
            horizon=float(np.diff(self._time([0, *self.ends, self.scans])).max())
            + self.scenario.true.gnss.delay,
        )

    def measurements(self, run: int) -> Arrivals:
        """Return the readings of aids, with their times (s), by the number of IMU intervals before
        they come; those of the height come with the inertial data."""
        found: Arrivals = defaultdict(list)
        time = self.trajectory.time
        if self._velocities is not None:
            settings = self.scenario.velocity
            for k, velocity in enumerate(self._velocities[run], 1):
                reading = VelocityReading.of(settings, velocity)
                if reading is not None:
                    found[k].append((float(time[k]), reading))
        if self._satellites is not None:
            self._add_satellites(self._satellites, run, found)
        return dict(found)

    def _add_satellites(self, fixes: SatelliteFixes, run: int, found: Arrivals) -> None:
        """Add what the satellite receiver of a run gives."""
        gnss, time = self.scenario.gnss, self.trajectory.time
        height_used = self.scenario.height.measured
        late = math.ceil(self.scenario.true.gnss.delay / self.trajectory.dt - 1e-9)
        for k, place, speed in zip(
            fixes.ends.tolist(), fixes.position[run], fixes.velocity[run], strict=True
        ):
            if np.isnan(place).any() or k + late > len(self.trajectory):
                continue
            rate = self._imu.angular_rate[run, k - 1]
            velocity = satellite_velocity(gnss, speed, rate)
            measured = [satellite_fix(gnss, place, height_used), velocity]
            found[k + late] += [(float(time[k]), one) for one in measured if one is not None]

    def at_once(self, before: int, scan: int) -> int:
        """Return how many scans may be dealt with at once: all from one to another, or one where
        measurements come late, which change the state of a scan after its reading has been taken.
        """
        return scan - before if self.scenario.true.gnss.delay == 0.0 else 1

    def advance(
        self, navigator: Navigator, run: int, before: int, scan: int, aids: Arrivals
    ) -> None:
        """Advance the navigator of a run from one scan to another."""
        first, last = self.index[[before, scan]].tolist()
        stops = [k for k in range(first + 1, last) if k in aids] if aids else []
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
            reduced = navigator.read(field, self._time(scans), sensed)
            if recorder is not None and field == 0 and run == 0:
                seen = navigator.inertial.track(self._time(scans))
                recorder.write_readings(scans - 1, reduced, seen)

    def track(self, navigator: Navigator, before: int, scan: int) -> Array:
        """Return the navigator's track at the scans after one and up to another."""
        return navigator.inertial.track(self._time(range(before + 1, scan + 1)))

    def _time(self, scans: Sequence[int] | Integers) -> Array:
        return self.trajectory.time[self.index[np.asarray(scans, dtype=np.int64)]]


def _readings(
    scenario: Scenario, trajectory: Trajectory, field_map: RouteMap, runs: Sequence[int]
) -> Array:
    """Return (R, S) or (R, S, C) what the instrument of a field senses at its scans."""
    source = true_map(scenario, trajectory, field_map)
    simulated = ReadingSimulator(scenario.true, trajectory, source, runs)
    return compensated(scenario, trajectory, simulated)
