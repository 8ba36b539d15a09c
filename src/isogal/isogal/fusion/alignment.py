"""Alignment: from inertial data and measurements to the first state that may be trusted
(docs/mathematics.md, section 3.20).

At rest the means of specific force and angular rate give a first attitude over a window that grows
until north is known to `COARSE`, or as well as it can be; on the move the change of a velocity and
the specific force level, and a bank of headings (`isogal.fusion.mixture`) leaves north open. From
there on the filter itself aligns, with the velocity zero at rest, and whatever measures position,
velocity and heading. A heading that was wrong by much has been linearised in the wrong place: once
it is known ten times as well, all is done again from a start with the better heading.

What the filter knows is a state like any other, and so is what it does not: the alignment is over
in name only, when the heading's 1-sigma is below the aim. A vehicle that stays at rest goes on to
learn."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.earth.gravity import normal_gravity_at
from isogal.fusion.aid_monitor import Without
from isogal.fusion.coarse import UNKNOWN_TILT, Place, Start, north_sigma
from isogal.fusion.inertial_navigator import InertialNavigator, track_row
from isogal.fusion.measurements import (
    AtRest,
    GroundVelocity,
    HeadingReading,
    Innovation,
    Measurement,
    Outcome,
    PositionFix,
    VelocityReading,
)
from isogal.fusion.model import FilterModel
from isogal.fusion.outage import HELD, UnknownMotion
from isogal.fusion.standstill import CONFIRMED, REST_SIGMA, Standstill, zero_velocity
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import (
    from_matrix,
    from_rotation_vector,
    matrix,
    multiply,
    to_rotation_vector,
)

UNKNOWN = math.pi / math.sqrt(3.0)
"""rad, 1-sigma of a heading that may be any."""
BEST_AIM = 1e-3
"""rad, 1-sigma of the heading at which a navigator is aligned, if its sensors can tell it."""
POOR_AIM = 0.1
"""The same of one whose gyroscopes cannot find north."""
POOR = 0.2
"""rad: gyroscopes that find north no better do not find it, as an error of this size is not
linear."""
COARSE = 0.02
"""rad, 1-sigma of the heading at which the filter takes over from the means at rest. While the
heading still changes by more, gyroscope biases and heading, which cannot be told apart at rest,
seem to be told apart by measurements that are linearised at different headings (the inconsistency
of Huang, Mourikis & Roumeliotis 2010). Gyroscopes that never get there are not given to the filter
before the vehicle moves."""
SHORTEST = 10.0
"""s, shortest time of which the means at rest are."""
SOLVED = 1.0, 10.0
"""s between solutions at rest, of one state and of a bank."""
UNITED = 0.15
"""rad, 1-sigma of the heading over a bank below which it is one state."""
AGAIN = 10.0
"""How many times better than at the start the heading is known when all is done again."""
LINEAR = 0.02
"""rad: of a start with this 1-sigma nothing is gained by that."""
LOOSE = 5.0
"""Sigmas that a start is given that comes from the same data: it then counts as 1/25 of them."""
SPREAD = 0.1
"""`FilterModel.alpha`: sigma points at 4.5 sigmas of a heading that is known to 0.1 rad are half a
radian away. There sin x / x is 0.96, a gyroscope's bias no longer balances the heading error that
it is the cause of, and the filter takes the difference for knowledge."""
NOT_MEASURED = 3.0
"""m/s, 1-sigma of an axis of a velocity that is not measured: up, or sideways."""
FARTHEST, FASTEST = 1e6, 100.0
"""m, m/s: 1-sigma of a place and of a velocity of which nothing is known."""
COURSE_SPEED = 3.0
"""m/s from which a course is taken for a heading."""
COURSE_SIGMA = 0.1
"""rad, 1-sigma of the difference: leeway, current, the mounting of the sensors."""


class Progress(NamedTuple):
    """How far an alignment is."""

    share: float
    """0 to 1, by the logarithm of the heading's 1-sigma."""
    heading: float
    """1-sigma, rad."""
    text: str
    """For example `aligning 40 %, heading +- 2.1 mrad`."""
    aligned: bool


class _Sample(NamedTuple):
    """One IMU sample."""

    time: float
    force: Array
    rate: Array
    height: float
    missing: float


class Alignment:
    """Finds the first state of a navigator.

    Parameters
    ----------
    model : FilterModel
        What it assumes; of the initial 1-sigmas those of the position and of the biases are used.
    position : (3,) array
        Latitude, longitude (rad), height (m) where it begins.
    measured : bool
        Whether a position is measured; the given one is then what is said until it comes.
    time : float
        Of the first sample's beginning, s.
    aim : float, optional
        1-sigma of the heading (rad) at which it is aligned; default: 1 mrad, or what its
        gyroscopes can tell at rest, or `POOR_AIM` where they cannot find north.
    horizon : float
        How old a measurement may be, s.
    course : bool
        Whether the forward axis goes where the vehicle does, so that a course tells the heading
        where the gyroscopes cannot.
    motion : UnknownMotion, optional
        See `InertialNavigator`.
    """

    def __init__(
        self,
        model: FilterModel,
        position: Array,
        time: float = 0.0,
        *,
        measured: bool = False,
        aim: float | None = None,
        horizon: float = 1200.0,
        course: bool = True,
        motion: UnknownMotion | None = None,
    ) -> None:
        self.model = replace(model, alpha=SPREAD)
        self.horizon, self._motion = horizon, motion
        self._given_aim, self._course = aim, course
        self._guess = np.array(position, dtype=float)
        self._place: Place | None = None
        if not measured:
            self._place = Place(self._guess, np.diag(np.square(model.initial_sigma[:2])))
        self._time = self._since = time
        """Of the newest sample; when the vehicle came to rest, s."""
        self._still = Standstill(model)
        self._resting = True
        """Whether nothing says that the vehicle moves."""
        self._velocity: tuple[float, Array, Array, bool] | None = None
        """Time, velocity, covariance and whether it is of the body, of the newest that was
        measured."""
        self._before: dict[bool, tuple[float, Array, Array, bool]] = {}
        """The newest of the body, and the newest over ground."""
        self._told = False
        """Whether anything but gyroscopes has told of the heading."""
        self._samples: list[_Sample] = []
        self._measured: list[tuple[float, Measurement]] = []
        self._zeros: list[float] = []
        """Stamps at which it is still to be confirmed that the vehicle was at rest."""
        self._start: Start | None = None
        self._spread = UNKNOWN
        """1-sigma of the heading at the start."""
        self._static = self.north > COARSE
        """Whether the means at rest are all that is used."""
        self._aligned = False
        self.navigator: InertialNavigator | None = None
        """None = there is no attitude yet."""

    @property
    def time(self) -> float:
        """Of the newest sample, s."""
        return self._time

    @property
    def latitude(self) -> float:
        """rad."""
        return float((self._guess if self._place is None else self._place.position)[0])

    @property
    def north(self) -> float:
        """1-sigma to which the gyroscopes can find north here (`north_sigma`)."""
        return north_sigma(self.model, self.latitude)

    @property
    def poor(self) -> bool:
        """Whether the gyroscopes cannot find north: at rest, or beside a velocity of the body,
        where the heading changes while it is still looked for."""
        moving = self._velocity is not None and self._velocity[3] and not self._rested
        return self.north > (COARSE if moving else POOR)

    @property
    def _rested(self) -> bool:
        """Whether it began at rest, or still may."""
        return self._resting if self._start is None else self._start.rest is not None

    @property
    def aim(self) -> float:
        """1-sigma of the heading at which it is aligned, rad."""
        if self._given_aim is not None:
            return self._given_aim
        return POOR_AIM if self.poor else max(BEST_AIM, 1.1 * self.north)

    @property
    def aligned(self) -> bool:
        """Whether the state may be trusted."""
        return self._aligned

    @property
    def over(self) -> bool:
        """Whether it is aligned, and the vehicle no longer at rest: the navigator needs it no
        more."""
        return self._aligned and not self._resting

    @property
    def navigation(self) -> InertialNavigator:
        """Who navigates from the first attitude on.

        Raises
        ------
        ValueError
            There is none yet.
        """
        if self.navigator is None:
            raise ValueError("there is no attitude yet")
        return self.navigator

    @property
    def state(self) -> FilterState:
        """The newest state, aligned or not; do not change it. While there is no attitude it is
        that of a vehicle at rest, level and heading north, of which nothing is known but the
        place."""
        if self.navigator is not None:
            return self.navigator.state
        position, spread = self._guess, np.eye(2) * FARTHEST**2
        if self._place is not None:
            position, spread = self._place.position, self._place.covariance
        level = Estimate(position, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        state = FilterState.start(level, self.model)
        state.covariance[:2, :2] = spread
        state.covariance[3:6, 3:6] = np.eye(3) * FASTEST**2
        state.covariance[6:9, 6:9] = np.diag(np.square([UNKNOWN_TILT, UNKNOWN_TILT, UNKNOWN]))
        return state

    @property
    def sample(self) -> tuple[Array, Array]:
        """Specific force and angular rate of the newest sample; do not change them."""
        return self.sample_at(self._time)

    @property
    def undecided(self) -> bool:
        """See `InertialNavigator`; what is open here is said by `progress`."""
        return self._aligned and self.navigation.undecided

    @property
    def heading_sigma(self) -> float:
        """1-sigma of the heading over all that may be, rad."""
        if self.navigator is None:
            return UNKNOWN
        mixture = self.navigator.known
        weights = np.exp(mixture.log_weights - np.logaddexp.reduce(mixture.log_weights))
        w, x, y, z = mixture.states[0].attitude
        turns = np.array(
            [
                to_rotation_vector(*multiply(*state.attitude, w, -x, -y, -z))[2]
                for state in mixture.states
            ]
        )
        variances = np.array([state.covariance[8, 8] for state in mixture.states])
        if len(turns) == 1:
            return float(math.sqrt(variances[0]))
        mean = abs(weights @ np.exp(1j * turns - 0.5 * variances))
        return min(UNKNOWN, math.sqrt(-2.0 * math.log(max(mean, 1e-9))))

    @property
    def progress(self) -> Progress:
        """How far it is."""
        sigma = self.heading_sigma
        whole = math.log(UNKNOWN / self.aim)
        share = 1.0 if self._aligned else min(0.99, max(0.0, math.log(UNKNOWN / sigma) / whole))
        size = f"{1e3 * sigma:.2g} mrad" if sigma < 0.1 else f"{math.degrees(sigma):.0f} deg"
        text = f"aligning {100.0 * share:.0f} %, heading ± {size}"
        if self._aligned:
            text = f"aligned, heading ± {size}"
        elif self._place is None:
            text = "aligning 0 %: waits for a position"
        elif self.poor and sigma > POOR:
            text += (
                f": the gyroscopes find north to {math.degrees(self.north):.0f} deg at best;"
                " waits for a course, a heading or a pose"
            )
        elif self.navigator is None and not self._resting:
            text += ": waits for a velocity"
        return Progress(share, sigma, text, self._aligned)

    def imu(
        self,
        time: Array | float,
        specific_force: Array,
        angular_rate: Array,
        height: Array | float = np.nan,
        missing: float = 0.0,
    ) -> Array:
        """Advance over IMU samples, and return the track; see `InertialNavigator.imu`. While there
        is no attitude it is that of a vehicle at rest, level and heading north."""
        times = np.atleast_1d(np.asarray(time, dtype=float))
        force = np.asarray(specific_force, dtype=float).reshape(-1, 3)
        rate = np.asarray(angular_rate, dtype=float).reshape(-1, 3)
        heights = np.broadcast_to(np.asarray(height, dtype=float), times.shape).tolist()
        rows = []
        for k, stamp in enumerate(times.tolist()):
            if not stamp > self._time:
                raise ValueError(f"stamp {stamp:.3f} s is not later than {self._time:.3f} s")
            if not (np.isfinite(force[k]).all() and np.isfinite(rate[k]).all()):
                raise ValueError("IMU sample is not finite")
            self._take(_Sample(stamp, force[k], rate[k], heights[k], 0.0 if k else missing))
            rows.append(track_row(self.state))
        return np.array(rows)

    def measure(self, time: float, *measurements: Measurement) -> Innovation:
        """Apply measurements of one time; return what became of the last."""
        result = Innovation(Outcome.USED)
        for one in measurements:
            if isinstance(one, PositionFix) and self.navigator is None:
                self._take_place(one)
            self._told |= isinstance(one, GroundVelocity | HeadingReading)
            if isinstance(one, GroundVelocity | VelocityReading):
                self._note(time, one)
            if self.navigator is None:
                if not isinstance(one, HeadingReading):
                    continue
            else:
                result = self.navigator.measure(time, one)
            self._measured.append((time, one))
            if isinstance(one, GroundVelocity):
                self._take_course(time, one)
        self._settle()
        return result

    def track(self, time: Array) -> Array:
        """Return (K, 13) the track at times (K,), s; before there was an attitude the place."""
        if self.navigator is None:
            return np.repeat(track_row(self.state)[None], len(time), axis=0)
        first = self._first_time
        return self.navigator.track(np.maximum(np.asarray(time, dtype=float), first))

    @property
    def _first_time(self) -> float:
        assert self._start is not None
        return self._start.time

    def measure_all(self, measurements: Sequence[tuple[float, Measurement]]) -> list[Innovation]:
        """Apply measurements; see `InertialNavigator.measure_all`."""
        if self._aligned:
            return self.navigation.measure_all(measurements)
        return [self.measure(time, one) for time, one in measurements]

    def sample_at(self, time: float) -> tuple[Array, Array]:
        """Return specific force and angular rate of the sample that a time (s) is in, or of the
        nearest; do not change them."""
        if self.navigator is not None and time > self._first_time:
            return self.navigator.sample_at(time)
        found = [one for one in self._samples if one.time >= time - 1e-6] or self._samples[-1:]
        if not found:
            return np.zeros(3), np.zeros(3)
        return found[0].force, found[0].rate

    def state_at(self, time: float) -> FilterState:
        """Return the state at a time; see `InertialNavigator.state_at`."""
        return self.state if self.navigator is None else self.navigator.state_at(time)

    def forecast(self, time: float, height: float = np.nan) -> FilterState:
        """Return the state at a later time; see `InertialNavigator.forecast`."""
        return self.navigation.forecast(time, height) if self._aligned else self.state

    def unaided(self, since: float) -> FilterState | None:
        """Return the newest state without satellites; see `InertialNavigator.unaided`."""
        return self.navigation.unaided(since) if self._aligned else None

    @property
    def without_satellites(self) -> Without | None:
        """What would be known without satellites; see `InertialNavigator.without_satellites`."""
        return self.navigation.without_satellites if self._aligned else None

    def back(self, samples: int) -> None:
        """Forget the newest samples; see `InertialNavigator.back`. While it is being aligned they
        stay: among many they do not matter."""
        if self._aligned:
            self.navigation.back(samples)
            self._time = self.navigation.time

    def _take(self, sample: _Sample) -> None:
        before, self._time = self._time, sample.time
        dt = sample.time - before
        if sample.missing > HELD:
            self._still.forget()
        rested = self._resting
        still = self._still.take(sample.force, sample.rate, dt)
        if rested and not still:
            self._zeros.clear()
        if not self._has_velocity:
            # nobody else says that the vehicle is at rest again once it has moved
            self._resting = self._resting and (still or self.navigator is None)
        if self._aligned:
            self._samples.clear()
            self._measured.clear()
        else:
            self._samples.append(sample)
        if self.navigator is None:
            if self._place is not None and self._resting:
                self._begin_at_rest()
                self._settle()
            return
        if self._solve_again(still):
            self._settle()
            return
        self.navigator.imu(sample.time, sample.force, sample.rate, sample.height, sample.missing)
        if self._resting and still and not self._static:
            self._zeros.append(sample.time)
            self._confirm()

    def _solve_again(self, still: bool) -> bool:
        """At rest with gyroscopes whose heading is not linear, solve again with the longer means
        instead of going on, where it is time; return whether that was done."""
        start, navigator = self._start, self.navigator
        if start is None or start.rest is None or navigator is None or not self._static:
            return False
        self._static = self._resting and still
        often = SOLVED[1] if navigator.undecided else SOLVED[0]
        if not self._static or self._time - start.time < often - 1e-6:
            return False
        self._begin_at_rest()
        return True

    @property
    def _has_velocity(self) -> bool:
        """Whether something measures the velocity."""
        return self._velocity is not None

    def _confirm(self) -> None:
        """Apply that the vehicle was at rest, of when that is confirmed."""
        assert self.navigator is not None
        while self._zeros and self._zeros[0] <= self._time - CONFIRMED:
            stamp = self._zeros.pop(0)
            zero = zero_velocity()
            result = self.navigator.measure(stamp, zero)
            self._measured.append((stamp, zero))
            if result.outcome is Outcome.REJECTED:
                self._resting = False
                self._zeros.clear()
        self._settle()

    def _note(self, time: float, measured: GroundVelocity | VelocityReading) -> None:
        """Note a velocity; the second of a vehicle that moves is a start."""
        of_body = isinstance(measured, VelocityReading)
        velocity = np.nan_to_num(np.asarray(measured.velocity, dtype=float))
        absent = np.isnan(np.asarray(measured.velocity, dtype=float))
        if absent[0]:
            return
        R = np.array(measured.covariance, dtype=float)
        sigma = math.sqrt(float(np.trace(R)))
        R[absent, absent] = NOT_MEASURED**2
        if isinstance(measured, VelocityReading) and measured.standstill_speed > np.linalg.norm(
            velocity
        ):
            sigma = measured.standstill_speed
        self._resting = bool(np.linalg.norm(velocity) < 3.0 * sigma) and self._still.seconds > 0.0
        before = self._before.get(of_body)
        self._velocity = self._before[of_body] = (time, velocity, R, of_body)
        waits = self.navigator is None and self._place is not None and not self._resting
        if waits and before is not None and time - before[0] <= HELD:
            self._begin_moving(before)

    def _take_place(self, fix: PositionFix) -> None:
        height = getattr(fix, "height", None)
        if height is None:
            known = [one.height for one in self._samples if math.isfinite(one.height)]
            height = known[-1] if known else self._guess[2]
        R = np.asarray(fix.covariance, dtype=float)[:2, :2]
        # an error that changes slowly is a state beside this one
        slow = [
            one.sigma
            for one in self.model.auxiliary
            if one.enters == "none" and one.name.endswith(("gnss_north", "gnss_east"))
        ]
        spread = R + np.eye(2) * max(slow, default=0.0) ** 2
        self._place = Place(np.array([fix.latitude, fix.longitude, height]), LOOSE * spread)

    def _take_course(self, time: float, measured: GroundVelocity) -> None:
        """Take the course of a vehicle that is fast enough for its heading, once."""
        north, east = np.asarray(measured.velocity)[:2].tolist()
        enough = max(COURSE_SPEED, 10.0 * math.sqrt(float(measured.covariance[0, 0])))
        if not (self._course and self.poor and math.hypot(north, east) > enough):
            return
        self._course = False
        if self.navigator is not None and self.heading_sigma > COURSE_SIGMA:
            reading = HeadingReading(math.atan2(east, north), COURSE_SIGMA**2)
            self.navigator.measure(time, reading)
            self._measured.append((time, reading))

    def _begin_at_rest(self) -> None:
        """Begin with the means at rest, if they are of long enough."""
        seconds = self._still.seconds
        if seconds < SHORTEST or self._place is None:
            return
        force, rate = self._still.means
        rest = AtRest(force, rate, seconds)
        gravity = normal_gravity_at(math.sin(self.latitude), float(self._place.position[2]))
        of_gravity = np.array([0.0, 0.0, -gravity])
        R = np.eye(3) * REST_SIGMA**2
        start = Start(
            self.model, self._time, self._place, np.zeros(3), R, False, (force, of_gravity),
            UNKNOWN_TILT, rest,
        )  # fmt: skip
        found = start.found
        assert found is not None
        state = start.state(found, UNKNOWN)
        sigma = math.sqrt(state.covariance[8, 8])
        if self._static and (self.poor or sigma > POOR):
            self._begin_bank(start)
        elif self._static or sigma <= COARSE:
            navigator = InertialNavigator(
                self.model, state, start.time, self.horizon, self._motion
            )
            self._begin(start, navigator)

    def _begin_moving(self, before: tuple[float, Array, Array, bool]) -> None:
        """Begin a bank of headings with a velocity and the one before it."""
        assert self._velocity is not None and self._place is not None
        time, velocity, R, of_body = self._velocity
        used = [one for one in self._samples if before[0] < one.time <= time + 1e-6]
        if not used:
            return
        seconds = time - before[0]
        force = np.mean([one.force for one in used], axis=0)
        rate = np.mean([one.rate for one in used], axis=0)
        acceleration = (velocity - before[1]) / seconds
        gravity = normal_gravity_at(math.sin(self.latitude), float(self._place.position[2]))
        felt = np.array([0.0, 0.0, -gravity])
        if of_body:
            force = force - acceleration - np.cross(rate, 0.5 * (velocity + before[1]))
        else:
            felt = felt + acceleration
        # the mean is of the middle of the interval, the start at its end
        w, x, y, z = from_rotation_vector(*(-0.5 * seconds * rate))
        force = matrix(np.array([w, x, y, z])) @ force
        late = time - used[-1].time
        spread = R + before[2] + np.eye(3) * (late * np.linalg.norm(acceleration)) ** 2
        sigma = self.model.initial_sigma
        tilt = LOOSE * math.hypot(
            float(np.max(sigma[9:12])) / gravity,
            self.model.noise[0] / math.sqrt(seconds) / gravity,
            math.sqrt(float(spread[0, 0])) / seconds / gravity,
            float(np.max(sigma[12:15])) * seconds,
        )
        start = Start(
            self.model, used[-1].time, self._place, velocity, spread, of_body, (force, felt),
            min(max(tilt, 1e-3), 0.3),
        )  # fmt: skip
        self._begin_bank(start)

    def _begin_bank(self, start: Start) -> None:
        navigator = InertialNavigator(
            self.model, start.bank(), start.time, self.horizon, self._motion
        )
        self._begin(start, navigator)

    def _begin(self, start: Start, navigator: InertialNavigator) -> None:
        """Go on from a start with the samples and the headings that came after it."""
        self._start, self.navigator = start, navigator
        self._static = self._static and start.rest is not None
        self._samples = [one for one in self._samples if one.time > start.time + 1e-6]
        self._measured = [one for one in self._measured if one[0] > start.time]
        self._spread = self.heading_sigma if len(navigator.known.states) == 1 else 0.1 * AGAIN
        self._replay(navigator)

    def _replay(self, navigator: InertialNavigator) -> None:
        """Give a navigator all samples and measurements since the start."""
        waiting = sorted(self._measured, key=lambda one: one[0])
        for sample in self._samples:
            navigator.imu(*sample)
            while waiting and waiting[0][0] <= navigator.time + 1e-6:
                navigator.measure(*waiting.pop(0))

    def _settle(self) -> None:
        """Unite a bank that agrees, begin again with a better heading, and see whether the aim is
        reached."""
        if self.navigator is None or self._aligned:
            return
        sigma = self.heading_sigma
        if self.navigator.undecided and sigma < UNITED:
            self.navigator.unite()
            sigma = self._spread = self.heading_sigma
            self._spread = max(sigma, 2.0 * LINEAR)
        if self.navigator.undecided:
            return
        if not self._static and self._spread > LINEAR and sigma < self._spread / AGAIN:
            self._again(sigma)
            sigma = self.heading_sigma
        if sigma <= self.aim and (self._told or not self.poor):
            self._aligned = True
            # what goes on without an aid from a bank says nothing of the aid
            self.navigator.monitors = {}

    def _again(self, sigma: float) -> None:
        """Begin again with the heading that is known now."""
        assert self._start is not None and self.navigator is not None
        heading = LOOSE * math.hypot(sigma, 3.0 * self._lost)
        if heading >= self._spread:
            self._spread = LINEAR
            return
        state = self._start.state(self._attitude_at_start(), heading)
        navigator = InertialNavigator(
            self.model, state, self._start.time, self.horizon, self._motion
        )
        self._replay(navigator)
        self.navigator, self._spread = navigator, heading

    @property
    def _lost(self) -> float:
        """1-sigma (rad) of a heading that is carried back to the start by the gyroscopes."""
        seconds = self._time - self._first_time
        return self.model.noise[5] * math.sqrt(max(seconds, 0.0))

    def _attitude_at_start(self) -> Array:
        """Return the attitude (4,) at the start that agrees with the newest: turned back by what
        the gyroscopes have felt since, without their biases, and by the navigation frame's own
        rotation (Groves 2013, section 5.4.1)."""
        assert self._start is not None and self.navigator is not None
        state, time = self.navigator.state, self._first_time
        bias = state.gyroscope_bias.copy()
        for one, value in zip(self.model.auxiliary, state.auxiliary.tolist(), strict=True):
            if one.enters == "gyroscope":
                bias[one.axis] += value
        turn = (1.0, 0.0, 0.0, 0.0)
        for sample in self._samples:
            angle = (sample.rate - bias) * (sample.time - time)
            turn, time = multiply(*turn, *from_rotation_vector(*angle.tolist())), sample.time
        seconds = time - self._first_time
        latitude = float(state.position[0])
        s, c = math.sin(latitude), math.cos(latitude)
        change = state.position - self._start.place.position
        east = EARTH_RATE * seconds + math.remainder(change[1], 2.0 * math.pi)
        frame = from_rotation_vector(east * c, -float(change[0]), -east * s)
        w, x, y, z = turn
        back = multiply(*state.attitude, w, -x, -y, -z)
        return np.asarray(from_matrix(matrix(np.array(multiply(*frame, *back)))))


Navigating: TypeAlias = InertialNavigator | Alignment
"""Who navigates: the filter, or until it is aligned the alignment."""
