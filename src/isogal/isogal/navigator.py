"""The navigator: strapdown and filter, batches and matcher, in one object.

    IMU samples → strapdown and filter ──→ state of each time
                        ↑        └→ readings, reduced with it → batch → matcher
                        └──────────────────── fix ←──────────────────────┘

The two halves, `isogal.fusion.inertial_navigator` and `isogal.matching.map_matching`, are what the
nodes of the graph run by themselves; a simulation runs both here. A run through the graph and one
through this object agree."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from isogal.afterwards import Sensed, smoothed_voyage
from isogal.arrays import Array
from isogal.earth.ellipsoid import in_radians
from isogal.fields.known_gravity import KnownGravity
from isogal.fields.measured import measured_field
from isogal.fix import Fix
from isogal.fusion.alignment import Alignment
from isogal.fusion.assumed import filter_model
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import Innovation, Measurement, measurements_of
from isogal.fusion.outage import HELD, UnknownMotion
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate, batch_difference
from isogal.inertial.rotations import matrix
from isogal.maps.channels import RouteMap
from isogal.matching.interfaces import Matcher
from isogal.matching.map_matching import MapMatching, Matched
from isogal.scenario import Assumed
from isogal.sensors.reduction import State


class Applied(NamedTuple):
    """A fix, and what became of it in the filter."""

    fix: Fix
    innovations: tuple[Innovation, ...]
    """Of each of its measurements."""
    seconds: float
    """s that the matcher took."""


class Navigator:
    """Navigates one vehicle by inertial data and readings of one or several fields.

    Parameters
    ----------
    assumed : Assumed
        Of sensors, maps and errors.
    maps : sequence of RouteMap
        Of each field.
    start : Estimate
        Position, velocity and attitude at `time`, with the errors that are assumed.
    time : float
        s.
    gravity : KnownGravity, optional
        What is known of horizontal gravity; default: as it is assumed.
    matcher : Matcher, optional
        Default: that of section `matcher`.
    horizon : float
        How old a measurement may be, s; infinite = the whole history is kept.

    Raises
    ------
    InputError
        The latitude at the start is in degrees, or settings do not fit matcher or maps.
    """

    def __init__(
        self,
        assumed: Assumed,
        maps: Sequence[RouteMap],
        start: Estimate,
        time: float = 0.0,
        *,
        gravity: KnownGravity | None = None,
        matcher: Matcher | None = None,
        horizon: float = 1200.0,
    ) -> None:
        in_radians(start.position[0])
        model = filter_model(assumed, gravity)
        motion = UnknownMotion().of_vehicle(assumed.velocity_aids)
        self.inertial: InertialNavigator
        if assumed.fusion.start == "align":
            self.inertial = Alignment(
                model,
                start.position,
                time,
                measured=assumed.gnss.used,
                aim=assumed.fusion.align_to,
                horizon=horizon,
                motion=motion,
            )
        else:
            state = FilterState.start(start, model)
            self.inertial = InertialNavigator(model, state, time, horizon, motion)
        self.matching = MapMatching(assumed, maps, matcher, gravity)
        each = assumed.each_field
        self._reductions = [measured_field(one).reduction(one) for one in each]
        self._has_arm = any(assumed.gravimeter.lever_arm)
        self._ends = time, time
        """Of the batch before the newest, and of the newest, s."""
        self._row_times = np.empty(0)
        """Of the newest batch, s."""
        self._passed = [0] * len(each)
        """Readings of each field before it was aligned."""
        self._each_scan = assumed.matcher.mode == "retrodiction"
        self._assumed, self._maps, self._whole = assumed, tuple(maps), math.isinf(horizon)
        self._sensed: list[list[Sensed]] = [[] for _ in each]
        """All readings, where the whole history is kept."""
        self._figures: Mapping[str, float] = {}
        """Of the last fix."""

    @property
    def time(self) -> float:
        """Of the newest state, s."""
        return self.inertial.time

    @property
    def aligned(self) -> bool:
        """Whether the state may be trusted: not while it is still being aligned."""
        return self.inertial.aligned

    @property
    def state(self) -> FilterState:
        """The newest state; do not change it."""
        return self.inertial.state

    def imu(
        self,
        time: Array | float,
        specific_force: Array,
        angular_rate: Array,
        height: Array | float = np.nan,
        missing: float = 0.0,
    ) -> Array:
        """Advance over IMU samples; see `InertialNavigator.imu`.

        Parameters
        ----------
        time : (S,) array or float
            Ends of the intervals, s.
        specific_force, angular_rate : (S, 3) or (3,) arrays
            Means over each interval, body axes, m/s² and rad/s.
        height : (S,) array or float
            Known or measured height, m; NaN = none.
        missing : float
            How much of the time before the first sample it does not cover, s.
        """
        before = None
        if missing > HELD and self.aligned:
            before = (self.time, self.state.batch_prior)
        aligned = self.aligned
        track = self.inertial.imu(time, specific_force, angular_rate, height, missing)
        if self.aligned and not aligned:
            self._ends = self.time, self.time
        if before is not None:
            self.matching.bridge(*before, self.time, self.state.batch_prior)
        return track

    def measure(self, time: float, *measurements: Measurement) -> Innovation:
        """Apply measurements of one time (s); see `InertialNavigator.measure`."""
        return self.inertial.measure(time, *measurements)

    def read(self, field: int, time: Array, readings: Array) -> Array:
        """Take readings of a field up to the newest IMU sample, oldest first, and return them
        reduced with the navigator's states of then. Those before it is aligned are not matched.

        Parameters
        ----------
        field : int
            Its place in the list of fields.
        time : (K,) array
            s.
        readings : (K,) or (K, C) array
            As sensed; NaN = none.
        """
        aligned = self.aligned
        track = self.inertial.track(time)
        position, velocity = track[:, :3], track[:, 3:6]
        latitude, longitude, height = position.T
        attitude = matrix(track[:, 6:10])
        turn = None
        if self._has_arm:
            turn = np.array([self.inertial.sample_at(one)[1] for one in time.tolist()])
        north, east = velocity[:, :2].T
        state = State(latitude, longitude, height, north, east, attitude, turn)
        reduced = np.asarray(self._reductions[field].reduce(readings, state))
        if not aligned:
            self._passed[field] += len(time)
            return reduced
        if self._whole:
            self._sensed[field].append(Sensed(time, np.array(readings, dtype=float)))
        self.matching.builders[field].begin(self._passed[field])
        for stamp, place, speed, reading in zip(time, position, velocity, reduced, strict=True):
            self.matching.add(field, float(stamp), place, speed, reading)
        return reduced

    def fix(self) -> Applied | None:
        """Match the batch that the newest readings end, if they end one, and apply its fix."""
        matched = self.match()
        if matched is None:
            return None
        return Applied(matched.fix, self.apply(matched.fix), matched.seconds)

    def match(self) -> Matched | None:
        """Match the batch that the newest readings end; None where they end none."""
        if not self.matching.ready:
            return None
        passage = self.inertial.passage(self._ends[1])
        self._ends = self._ends[1], self.time
        self.inertial.keep(self.time)
        matched = self.matching.match(self.state.batch_prior, passage=passage)
        self._row_times = matched.batch.time
        return matched

    def smoothed(self, time: Array) -> list[FilterState]:
        """Return the states at times (K,), s, rising, as all data so far have them; with an
        infinite horizon as `isogal.afterwards` has the whole voyage. The navigator is not changed.

        Raises
        ------
        ValueError
            A time is not within the horizon, or nothing is aligned yet.
        """
        if not self.aligned:
            raise ValueError("the navigator is not aligned yet")
        if not self._whole:
            return self.inertial.smoothed(time)
        voyage = self._assumed, self._maps, self.sensed, self._figures
        return smoothed_voyage(self.inertial, time, *voyage)

    @property
    def sensed(self) -> list[Sensed | None]:
        """All readings of each field; None = there are none, or the horizon is finite."""
        return [Sensed.joined(parts) if parts else None for parts in self._sensed]

    def apply(self, fix: Fix, relative_to: Estimate | None = None) -> tuple[Innovation, ...]:
        """Apply a fix of any time within the horizon, and carry what it changes back to the
        readings; return what became of each of its measurements.

        Parameters
        ----------
        fix : Fix
        relative_to : Estimate, optional
            The navigator's estimate that the batch was built with, of a fix that comes late.
        """
        before = Estimate(*(part.copy() for part in self.state.estimate))
        shares = self._shares(fix) if self._each_scan else [(fix.time, fix)]
        parts = [
            (time, one) for time, part in shares for one in measurements_of(part, relative_to)
        ]
        innovations = self.inertial.measure_all(parts) if parts else []
        self._figures = fix.diagnostics or self._figures
        jump = batch_difference(self.state.estimate, before)
        if jump.any():
            self.matching.correct(self.time, jump)
        return tuple(innovations)

    def _shares(self, fix: Fix) -> list[tuple[float, Fix]]:
        """Return the shares of a fix for each scan since the last batch, with their times, for
        retrodiction; the fix itself where it has none, or makes the navigator less certain."""
        if fix.widening is not None or fix.scan_position is None:
            return [(fix.time, fix)]
        times = np.unique(self._row_times)  # a scan of several channels has several rows
        times = times[-len(fix.scan_position) :]
        found = [(float(time), fix.of_scan(k)) for k, time in enumerate(times)]
        return [(time, one) for time, one in found if one is not None and time > self._ends[0]]
