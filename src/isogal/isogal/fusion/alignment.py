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
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.earth.gravity import normal_gravity_at
from isogal.fusion.aid_monitor import AidMonitor
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
from isogal.fusion.mixture import Mixture
from isogal.fusion.model import FilterModel
from isogal.fusion.outage import HELD, UnknownMotion
from isogal.fusion.segment import AT_ONCE, Segment
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


class _Velocity(NamedTuple):
    """A velocity that was measured."""

    time: float
    """s."""
    velocity: Array
    """(3,) m/s; 0 = not measured."""
    covariance: Array
    """(3, 3) (m/s)²."""
    of_body: bool
    """Whether it is in body axes, not NED."""


class Alignment(InertialNavigator):
    """A navigator that finds its first state itself.

    Until there is one it stays where it is said to be, level and heading north, and promises
    nothing but the place. From then on all is kept until it is aligned, to begin again.

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
        How old a measurement may be once it is aligned, s.
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
        model = replace(model, alpha=SPREAD, unsure_heading=True)
        known = (FARTHEST, FARTHEST) if measured else model.initial_sigma[:2]
        self._place = Place(np.array(position, dtype=float), np.diag(np.square(known)))
        self._placed = not measured
        self._given_aim, self._course, self._later_horizon = aim, course, horizon
        self._still = Standstill(model)
        self._resting = True
        """Whether nothing says that the vehicle moves."""
        self._velocity: _Velocity | None = None
        """The newest that was measured."""
        self._before: dict[bool, _Velocity] = {}
        """The newest of the body, and the newest over ground."""
        self._told = False
        """Whether anything but gyroscopes has told of the heading."""
        self._zeros: list[float] = []
        """Stamps at which it is still to be confirmed that the vehicle was at rest."""
        self._start: Start | None = None
        """None = there is no attitude yet."""
        self._spread = UNKNOWN
        """1-sigma of the heading at the start."""
        self._static = False
        """Whether the means at rest are all that is used."""
        self.aligned = False
        """Whether the state may be trusted."""
        motion = replace(motion or UnknownMotion(), heading=UNKNOWN)
        super().__init__(model, self._unknown(model), time, horizon, motion)

    def _unknown(self, model: FilterModel) -> FilterState:
        """Return the state of a vehicle of which nothing is known but the place."""
        level = Estimate(self._place.position, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        state = FilterState.start(level, model)
        state.covariance[:2, :2] = self._place.covariance
        state.covariance[3:6, 3:6] = np.eye(3) * FASTEST**2
        state.covariance[6:9, 6:9] = np.diag(np.square([UNKNOWN_TILT, UNKNOWN_TILT, UNKNOWN]))
        return state

    @property
    def latitude(self) -> float:
        """Where it begins, rad."""
        return float(self._place.position[0])

    @property
    def north(self) -> float:
        """1-sigma to which the gyroscopes can find north there (`north_sigma`)."""
        return north_sigma(self.model, self.latitude)

    @property
    def poor(self) -> bool:
        """Whether the gyroscopes cannot find north: at rest, or beside a velocity of the body,
        where the heading changes while it is still looked for."""
        rested = self._resting if self._start is None else self._start.rest is not None
        by_body = self._velocity is not None and self._velocity.of_body and not rested
        return self.north > (COARSE if by_body else POOR)

    @property
    def aim(self) -> float:
        """1-sigma of the heading at which it is aligned, rad."""
        if self._given_aim is not None:
            return self._given_aim
        return POOR_AIM if self.poor else max(BEST_AIM, 1.1 * self.north)

    @property
    def over(self) -> bool:
        """Whether it is aligned, and has moved since: it is a navigator like any other."""
        return self.aligned and not self._resting

    @property
    def heading_sigma(self) -> float:
        """1-sigma of the heading over all that may be, rad."""
        states = self.known.states
        variances = np.array([state.covariance[8, 8] for state in states])
        if len(states) == 1:
            return float(math.sqrt(variances[0]))
        w, x, y, z = states[0].attitude
        turns = np.array(
            [to_rotation_vector(*multiply(*one.attitude, w, -x, -y, -z))[2] for one in states]
        )
        mean = float(abs(np.exp(self.known.log_weights) @ np.exp(1j * turns - 0.5 * variances)))
        return min(UNKNOWN, math.sqrt(-2.0 * math.log(max(mean, 1e-9))))

    @property
    def progress(self) -> tuple[float, str]:
        """How far it is: 0 to 1, by the logarithm of the heading's 1-sigma; and in words, for
        example `aligning 40 %, heading ± 2.1 mrad`."""
        sigma = self.heading_sigma
        if self.aligned:
            return 1.0, "aligned"
        if not self._placed:
            return 0.0, "aligning 0 %: waits for a position"
        share = math.log(UNKNOWN / sigma) / math.log(UNKNOWN / self.aim)
        share = min(0.99, max(0.0, share))
        size = f"{1e3 * sigma:.2g} mrad" if sigma < 0.1 else f"{math.degrees(sigma):.0f} deg"
        text = f"aligning {100.0 * share:.0f} %, heading ± {size}"
        if self.poor and sigma > POOR:
            text += (
                f": the gyroscopes find north to {math.degrees(self.north):.0f} deg at best;"
                " waits for a course, a heading or a pose"
            )
        elif self._start is None and not self._resting:
            text += ": waits for a velocity"
        return share, text

    def imu(
        self,
        time: Array | float,
        specific_force: Array,
        angular_rate: Array,
        height: Array | float = np.nan,
        missing: float = 0.0,
    ) -> Array:
        """Advance over IMU samples, and return the track; see `InertialNavigator.imu`."""
        if self.over:
            return super().imu(time, specific_force, angular_rate, height, missing)
        times = np.atleast_1d(np.asarray(time, dtype=float))
        force, rate = (
            np.asarray(one, dtype=float).reshape(-1, 3) for one in (specific_force, angular_rate)
        )
        heights = np.broadcast_to(np.asarray(height, dtype=float), times.shape).tolist()
        rows = []
        for k, stamp in enumerate(times.tolist()):
            before, gap = self.time, 0.0 if k else missing
            super().imu(stamp, force[k], rate[k], heights[k], gap)
            self._look(force[k], rate[k], stamp - before, gap)
            rows.append(track_row(self.state))
        return np.array(rows)

    def measure_all(self, measurements: Sequence[tuple[float, Measurement]]) -> list[Innovation]:
        """Apply measurements; see `InertialNavigator.measure_all`. Of those that come before there
        is an attitude only the first state is made."""
        if self.over:
            return super().measure_all(measurements)
        begun = self._start is not None
        for time, one in measurements:
            self._hear(time, one)
        if not begun:
            return [Innovation(Outcome.USED)] * len(measurements)
        found = super().measure_all(measurements)
        pairs = list(zip(measurements, found, strict=True))
        if any(isinstance(one, HeadingReading) and what.used for (_, one), what in pairs):
            self._told, self._static = True, False
        for (time, one), _ in pairs:
            if isinstance(one, GroundVelocity):
                self._take_course(time, one)
        self._settle()
        return found

    def forecast(self, time: float, height: float = np.nan) -> FilterState:
        """Return the state at a later time; see `InertialNavigator.forecast`."""
        return super().forecast(time, height) if self.aligned else self.state

    def back(self, samples: int) -> None:
        """Forget the newest samples; see `InertialNavigator.back`. While it is being aligned they
        stay: among many they do not matter."""
        if self.aligned:
            super().back(samples)

    def _carried(self, before: Mixture, segment: Segment) -> tuple[Mixture, Array]:
        if self._start is not None:
            return super()._carried(before, segment)
        rows = np.repeat(track_row(before.merged)[None], len(segment.time), axis=0)
        return before.copy(), rows

    def _monitor(self, source: str) -> AidMonitor | None:
        # what goes on without an aid from a bank says nothing of the aid
        return super()._monitor(source) if self.aligned else None

    def _look(self, force: Array, rate: Array, dt: float, missing: float) -> None:
        """See what a sample says of whether the vehicle is at rest, and what follows."""
        if missing > HELD:
            self._still.forget()
        still, rested = self._still.take(force, rate, dt), self._resting
        if not still:
            self._zeros.clear()
        if self._velocity is None:
            # nobody else says that the vehicle is at rest again once it has moved
            self._resting = rested and (still or self._start is None)
        self._static &= self._resting and still
        if self._start is None:
            if self._placed and self._resting:
                self._begin_at_rest()
        elif self._static:
            # a heading that is not linear is solved again with the longer means
            often = SOLVED[1] if self.undecided else SOLVED[0]
            if self.time - self._start.time >= often - 1e-6:
                self._begin_at_rest()
        elif self._resting and still:
            self._zeros.append(self.time)
            self._confirm()
        self._settle()

    def _confirm(self) -> None:
        """Apply that the vehicle was at rest, of when that is confirmed."""
        while self._zeros and self._zeros[0] <= self.time - CONFIRMED:
            zero = self._zeros.pop(0), zero_velocity()
            if super().measure_all([zero])[0].outcome is Outcome.REJECTED:
                self._resting = False
                self._zeros.clear()

    def _hear(self, time: float, measured: Measurement) -> None:
        """Note what a measurement says of place and velocity; the second velocity of a vehicle
        that moves is a start."""
        if isinstance(measured, PositionFix) and self._start is None:
            self._take_place(measured)
        self._told |= isinstance(measured, GroundVelocity)
        if not isinstance(measured, GroundVelocity | VelocityReading):
            return
        velocity = np.array(measured.velocity, dtype=float)
        absent = np.isnan(velocity)
        if absent[0]:
            return
        R = np.array(measured.covariance, dtype=float)
        slowest = 3.0 * math.sqrt(float(np.trace(R)))
        R[absent, absent], velocity[absent] = NOT_MEASURED**2, 0.0
        of_body = isinstance(measured, VelocityReading)
        speed = float(np.linalg.norm(velocity))
        if isinstance(measured, VelocityReading) and measured.aid.standstill_speed > speed:
            slowest = 3.0 * measured.aid.standstill_speed
        self._resting = speed < slowest and self._still.seconds > 0.0
        before = self._before.get(of_body)
        self._velocity = self._before[of_body] = _Velocity(time, velocity, R, of_body)
        waits = self._start is None and self._placed and not self._resting
        if waits and before is not None and time - before.time <= HELD:
            self._begin_moving(before, self._velocity)

    def _take_place(self, fix: PositionFix) -> None:
        height = fix.height
        if height is None:
            known = float(self._segments[-1].height[-1])
            height = known if math.isfinite(known) else self._place.position[2]
        # an error that changes slowly is a state beside this one
        slow = [
            one.sigma
            for one in self.model.auxiliary
            if one.enters == "none" and one.name.endswith(("gnss_north", "gnss_east"))
        ]
        spread = np.asarray(fix.covariance, dtype=float)[:2, :2]
        spread = LOOSE * (spread + np.eye(2) * max(slow, default=0.0) ** 2)
        self._place = Place(np.array([fix.latitude, fix.longitude, height]), spread)
        self._placed = True
        self._segments[-1].after = Mixture.of(self._unknown(self.model))

    def _take_course(self, time: float, measured: GroundVelocity) -> None:
        """Take the course of a vehicle that is fast enough for its heading, once."""
        north, east = np.asarray(measured.velocity)[:2].tolist()
        enough = max(COURSE_SPEED, 10.0 * math.sqrt(float(measured.covariance[0, 0])))
        if not (self._course and self.poor and math.hypot(north, east) > enough):
            return
        self._course = False
        if self.heading_sigma > COURSE_SIGMA:
            reading = HeadingReading(math.atan2(east, north), COURSE_SIGMA**2)
            super().measure_all([(time, reading)])

    def _begin_at_rest(self) -> None:
        """Begin with the means at rest, if they are of long enough."""
        seconds = self._still.seconds
        if seconds < SHORTEST:
            return
        force, rate = self._still.means
        R = np.eye(3) * REST_SIGMA**2
        start = Start(
            self.model, self.time, self._place, np.zeros(3), R, False, (force, self._felt),
            UNKNOWN_TILT, AtRest(force, rate, seconds),
        )  # fmt: skip
        found = start.found
        assert found is not None
        state = start.state(found, UNKNOWN)
        sigma = math.sqrt(state.covariance[8, 8])
        static = self.north > COARSE
        if static and (self.poor or sigma > POOR):
            self._begin(start, start.bank(), static)
        elif static or sigma <= COARSE:
            self._begin(start, Mixture.of(state), static)

    @property
    def _felt(self) -> Array:
        """(3,) specific force of a vehicle at rest, NED, m/s²."""
        height = float(self._place.position[2])
        return np.array([0.0, 0.0, -normal_gravity_at(math.sin(self.latitude), height)])

    def _begin_moving(self, before: _Velocity, now: _Velocity) -> None:
        """Begin a bank of headings with a velocity and the one before it."""
        used = [one for one in self._segments if before.time < one.end <= now.time + AT_ONCE]
        if not used:
            return
        seconds = now.time - before.time
        force = np.concatenate([one.force for one in used]).mean(axis=0)
        rate = np.concatenate([one.rate for one in used]).mean(axis=0)
        acceleration = (now.velocity - before.velocity) / seconds
        felt = self._felt
        gravity = float(np.linalg.norm(felt))
        if now.of_body:
            centripetal = np.cross(rate, 0.5 * (now.velocity + before.velocity))
            force = force - acceleration - centripetal
        else:
            felt = felt + acceleration
        # the mean is of the middle of the interval, the start at its end
        force = matrix(np.array(from_rotation_vector(*(-0.5 * seconds * rate)))) @ force
        late = now.time - used[-1].end
        spread = now.covariance + before.covariance
        spread = spread + np.eye(3) * (late * np.linalg.norm(acceleration)) ** 2
        sigma = self.model.initial_sigma
        tilt = LOOSE * math.hypot(
            float(np.max(sigma[9:12])) / gravity,
            self.model.noise[0] / math.sqrt(seconds) / gravity,
            math.sqrt(float(spread[0, 0])) / seconds / gravity,
            float(np.max(sigma[12:15])) * seconds,
        )
        start = Start(
            self.model, used[-1].end, self._place, now.velocity, spread, now.of_body,
            (force, felt), min(max(tilt, 1e-3), 0.3),
        )  # fmt: skip
        self._begin(start, start.bank(), False)

    def _begin(self, start: Start, known: Mixture, static: bool) -> None:
        """Go on from a start with the samples and the measurements that came after it."""
        self._start, self._static, self.horizon = start, static, math.inf
        self.go_on_from(start.time, known)
        self._spread = self.heading_sigma if len(known.states) == 1 else 0.1 * AGAIN

    def _settle(self) -> None:
        """Unite a bank that agrees, begin again with a better heading, and see whether the aim is
        reached."""
        if self._start is None or self.aligned:
            return
        sigma = self.heading_sigma
        if self.undecided and sigma < UNITED:
            self.unite()
            sigma = self.heading_sigma
            self._spread = max(sigma, 2.0 * LINEAR)
        if self.undecided:
            return
        if not self._static and self._spread > LINEAR and sigma < self._spread / AGAIN:
            self._again(self._start, sigma)
            sigma = self.heading_sigma
        if sigma <= self.aim and (self._told or not self.poor):
            self.aligned, self.horizon = True, self._later_horizon

    def _again(self, start: Start, sigma: float) -> None:
        """Begin again with the heading that is known now."""
        lost = self.model.noise[5] * math.sqrt(self.time - start.time)
        heading = LOOSE * math.hypot(sigma, 3.0 * lost)
        if heading >= self._spread:
            self._spread = LINEAR
            return
        state = start.state(self._attitude_at(start), heading)
        self.go_on_from(start.time, Mixture.of(state))
        self._spread = heading

    def _attitude_at(self, start: Start) -> Array:
        """Return the attitude (4,) at the start that agrees with the newest: turned back by what
        the gyroscopes have felt since, without their biases, and by the navigation frame's own
        rotation (Groves 2013, section 5.4.1)."""
        state, time = self.state, start.time
        bias = state.gyroscope_bias.copy()
        for one, value in zip(self.model.auxiliary, state.auxiliary.tolist(), strict=True):
            if one.enters == "gyroscope":
                bias[one.axis] += value
        turn = (1.0, 0.0, 0.0, 0.0)
        for stamp, rate in zip(*self.samples(time, self.time), strict=True):
            angle = (rate - bias) * (stamp - time)
            turn, time = multiply(*turn, *from_rotation_vector(*angle.tolist())), stamp
        seconds = time - start.time
        s, c = math.sin(state.position[0]), math.cos(state.position[0])
        change = state.position - start.place.position
        east = EARTH_RATE * seconds + math.remainder(change[1], 2.0 * math.pi)
        frame = from_rotation_vector(east * c, -float(change[0]), -east * s)
        w, x, y, z = turn
        back = multiply(*state.attitude, w, -x, -y, -z)
        return np.asarray(from_matrix(matrix(np.array(multiply(*frame, *back)))))
