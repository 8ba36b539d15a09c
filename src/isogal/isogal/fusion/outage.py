"""What a navigator still knows after a time without inertial data.

Nothing was measured of how the vehicle moved meanwhile. It is taken to have kept its velocity and
attitude, and its unknown motion as a constant acceleration and a constant turn: with a 1-sigma
acceleration a over a time T the velocity is wrong by a T and the position by a T² / 2, wholly
correlated, and the attitude by the turn rate times T. A vehicle on wheels turns on roads: its turn
rate is taken to change as `Turns` says. Where the acceleration lasts for L < T only,
at a time of which nothing is known, the velocity is wrong by a L, the position by a L T / 2 and,
independently, by a L (T - L) / sqrt(12). A vehicle of speed v that turned round has
changed its velocity by 2 v at most, so the sigma of the velocity does not grow beyond v.

The samples at either side say whether the vehicle was moving steadily then. A manoeuvre that goes
on beyond the gap shows as a change of the specific force or of the angular rate, and that change
is the 1-sigma of the unknown motion. A manoeuvre inside the gap is not seen; of a gap as short as
`HELD` none is expected, in a longer one there was one with the probability 1 - exp(-T / time
between manoeuvres) of a Poisson process. Whether there was is for the fixes after the gap to say:
the navigator goes on with both (`isogal.fusion.mixture`). A level vehicle whose specific force is
the same afterwards has the same tilt, unless it accelerates by just as much: its tilt grows no
further than the change of the force divided by gravity."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE, metres_per_radian
from isogal.earth.gravity import normal_gravity_at
from isogal.fusion.model import FilterModel
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import matrix
from isogal.scenario import Velocity

HELD = 10.0
"""s up to which the sample after a gap stands for the gap as well; over a longer one the vehicle
is taken to have kept its velocity and attitude."""
STEP = 10.0
"""s, longest step over a gap."""
SLOWEST = 1.0
"""m/s that a vehicle at rest may have moved with."""
LARGEST_TILT, LARGEST_HEADING = 0.02, 0.5
"""rad, largest 1-sigma that an outage adds: of a level vehicle's attitude, and where the filter
still holds."""
MANOEUVRE = 60.0
"""s that a manoeuvre lasts at most."""
TILT_SHARE = 0.1
"""Of the turn rate, about horizontal axes."""
GRAVITY = 9.8
"""m/s², of the specific force that a tilt changes."""
CAR = 0.4, 0.036, 100.0
"""m/s², rad/s and s, the same as `UnknownMotion` has: the speed of a car changed by 0.15 to
0.22 m/s² in half minutes of four drives, and its turn rate has this 1-sigma while it moves
(docs/evidence/drives.md)."""
TURN_TIME, TURN_FREEDOM = 4.5, 4.0
"""s over which a car's turn rate changes, and degrees of freedom of its distribution (ibid.)."""
FINE, SETTLED = 1.0, 5.0
"""s, step over a gap while a turn goes on, and the times of `Turns` after which it is over."""


@dataclass(frozen=True, slots=True)
class Turns:
    """How the turn rate of a vehicle changes: a Student t process (Shah, Wilson & Ghahramani 2014,
    AISTATS) with the covariance sigma² exp(-t / time). What it turns by in a gap, given the rates
    at either side, has the moments of an Ornstein-Uhlenbeck bridge, and the variance times what
    these rates say of its scale: a car that is in a turn turns more than one that goes straight
    ahead."""

    sigma: float
    """rad/s."""
    time: float = TURN_TIME
    """s."""
    freedom: float = TURN_FREEDOM
    """Degrees of freedom, more than 2."""

    def angle(self, gap: float, rates: tuple[float, float], until: float) -> float:
        """Return the mean angle (rad) by which it has turned so many seconds into a gap (s), given
        the rates (rad/s) before and after that."""
        before, after = rates
        left, begun, ended, whole = (
            math.exp(-t / self.time) for t in (until, gap - until, gap + until, gap)
        )
        early = 1.0 + whole**2 - left - begun * whole
        late = begun + ended - 2.0 * whole
        return self.time * (before * early + after * late) / (1.0 - whole**2)

    def variance(self, gap: float, rates: tuple[float, float]) -> float:
        """Return the variance (rad²) of the angle over a gap, given the rates likewise."""
        before, after = rates
        whole, half = math.exp(-gap / self.time), math.tanh(0.5 * gap / self.time)
        free = 2.0 * self.sigma**2 * self.time * (gap - 2.0 * self.time * half)
        seen = before**2 + after**2 - 2.0 * whole * before * after
        seen /= self.sigma**2 * (1.0 - whole**2)
        return free * (self.freedom - 2.0 + seen) / self.freedom


@dataclass(frozen=True, slots=True)
class UnknownMotion:
    """1-sigma of how a vehicle moves while nothing measures it."""

    acceleration: float = 0.1
    """m/s²."""
    turn_rate: float = 1e-3
    """rad/s, about the vertical."""
    between: float = 600.0
    """s, mean time between manoeuvres."""
    tilt: float = LARGEST_TILT
    """rad, largest change of tilt."""
    lasts: float = math.inf
    """s that it moves so at most; for longer its velocity is constant."""
    turns: Turns | None = None
    """Of a vehicle that goes where its heading is: its velocity turns as it does; None = it need
    not, and its turn rate is constant."""
    heading: float = LARGEST_HEADING
    """rad, largest 1-sigma of the heading that a gap adds."""

    def of_vehicle(self, aids: Sequence[Velocity]) -> "UnknownMotion":
        """Return that of a vehicle, given its sensors of the velocity: one on wheels moves at
        least as a car does."""
        if not any(aid.kind == "wheels" for aid in aids):
            return self
        acceleration, turn_rate, between = CAR
        return replace(
            self,
            acceleration=max(self.acceleration, acceleration),
            between=min(self.between, between),
            turns=Turns(max(self.turn_rate, turn_rate)),
        )

    def seen(self, change: tuple[Array, Array], manoeuvre: bool) -> "UnknownMotion":
        """Return what is still unknown of a gap, with or without a manoeuvre in it, given the
        change of the specific force and of the angular rate, (3,) each, from the sample before it
        to the one after it."""
        force, rate = (float(np.linalg.norm(part)) for part in change)
        if self.turns is not None:  # across it feels its turns
            force = abs(float(change[0][0]))
        share = float(manoeuvre)
        return replace(
            self,
            acceleration=math.hypot(share * self.acceleration, force),
            turn_rate=math.hypot(share * self.turn_rate, rate),
            tilt=min(self.tilt, force / GRAVITY),
            lasts=MANOEUVRE if share * self.acceleration > force else math.inf,
        )

    def possible(
        self, seconds: float, change: tuple[Array, Array], rates: tuple[float, float]
    ) -> "list[tuple[float, UnknownMotion]]":
        """Return what may have happened in a gap, with log probabilities: no manoeuvre, then, if
        it is long enough and that would be another motion, one; see `seen`. Of a vehicle whose
        turns have a law there is one motion, given its turn rates (rad/s) at either side."""
        steady, manoeuvre = (self.seen(change, which) for which in (False, True))
        if self.turns is not None:
            variance = self.turns.variance(seconds, rates)
            if seconds <= HELD:  # it is taken to have turned as afterwards
                variance += (rates[1] * seconds - self.turns.angle(seconds, rates, seconds)) ** 2
            one = steady if seconds <= HELD else manoeuvre
            return [(0.0, replace(one, turn_rate=math.sqrt(variance) / seconds))]
        if seconds <= HELD or manoeuvre == steady:
            return [(0.0, steady)]
        none = -seconds / self.between
        return [(none, steady), (math.log(-math.expm1(none)), manoeuvre)]


def outage_covariance(seconds: float, speed: float, motion: UnknownMotion) -> Array:
    """Return (9, 9) what an outage adds to the covariance of position (m), velocity (m/s) and
    attitude (rad), NED, of a vehicle of a speed (m/s)."""
    speed, lasts = max(speed, SLOWEST), min(motion.lasts, seconds)
    times = math.sqrt(max(seconds / motion.between, 1.0)) if lasts < seconds else 1.0
    free = times * motion.acceleration * lasts
    velocity = free / math.hypot(1.0, free / speed)
    heading = min(motion.turn_rate * seconds, motion.heading)
    tilt = min(TILT_SHARE * motion.turn_rate * seconds, motion.tilt)
    root = np.zeros((9, 9))
    for axis in range(3):
        root[axis, axis] = 0.5 * velocity * seconds
        root[3 + axis, axis] = velocity
        root[axis, 6 + axis] = velocity * (seconds - lasts) / math.sqrt(12.0)
    root[6, 3], root[7, 4], root[8, 5] = tilt, tilt, heading
    return np.asarray(root @ root.T, dtype=np.float64)


def grow(state: FilterState, seconds: float, motion: UnknownMotion) -> None:
    """Add what an outage adds to the covariance, in place. Vertical errors stay: the height is
    known, or a sensor says it."""
    speed = float(np.hypot(*state.velocity[:2]))
    added = outage_covariance(seconds, speed, motion)
    if motion.turns is not None and speed > SLOWEST:
        added = _rolled(added, seconds, state.velocity[:2])
    added[[2, 5], :] = added[:, [2, 5]] = 0.0
    state.covariance[:9, :9] += added


def _rolled(added: Array, seconds: float, velocity: Array) -> Array:
    """Return what an outage adds, `added` (9, 9), for a vehicle that goes where its heading is,
    with a velocity (2,): along it as any vehicle, across it what the turn of the heading makes of
    that. It turns at a time of which nothing is known, so that the place is off by half the gap's
    length times what the velocity is off, and independently by that over sqrt(12). A turn of psi,
    N(0, s), also shortens the way along it, by 1 - cos(psi), whose mean square is
    1 - 2 exp(-s / 2) + (1 + exp(-2 s)) / 2."""
    north, east = velocity
    forward = velocity / math.hypot(north, east)
    kept = np.eye(9)
    kept[:2, :2] = kept[3:5, 3:5] = np.outer(forward, forward)
    kept[8, 8] = 0.0
    s = float(added[8, 8])
    across = math.sqrt(s) * np.array([-east, north])
    shorter = 1.0 - 2.0 * math.exp(-0.5 * s) + 0.5 * (1.0 + math.exp(-2.0 * s))
    root = np.zeros((9, 4))
    root[8, 0] = math.sqrt(s)
    for column, off in ((0, across), (2, math.sqrt(shorter) * velocity)):
        root[:2, column] = off * seconds / 2.0
        root[3:5, column] = off
        root[:2, column + 1] = off * seconds / math.sqrt(12.0)
    return np.asarray(kept @ added @ kept.T + root @ root.T)


def keep_going(
    state: FilterState,
    model: FilterModel,
    seconds: float,
    height: float,
    turns: Turns | None = None,
    rates: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Advance a state as if the vehicle kept its velocity and attitude, in place, or turned on as
    its turn rates at either side say.

    Parameters
    ----------
    state : FilterState
    model : FilterModel
    seconds : float
    height : float
        Known height, m; NaN = not known.
    turns : Turns, optional
        How its turn rate changes; None = it keeps its attitude.
    rates : (float, float)
        rad/s, before and after.
    """
    ends, turned = _steps(seconds, turns), 0.0
    for begin, end in itertools.pairwise(ends.tolist()):
        step, before = end - begin, turned
        turned = 0.0 if turns is None else turns.angle(seconds, rates, end)
        force, rate = steady_sample(state, (turned - before) / step)
        propagate(state, model, force[None], rate[None], np.array([height]), step)


def _steps(seconds: float, turns: Turns | None) -> Array:
    """Return the ends (s) of the steps over a gap, which begin with 0."""
    near = 0 if turns is None else min(int(SETTLED * turns.time), math.ceil(0.5 * seconds) - 1)
    rest = seconds - 2.0 * near * FINE
    middle = np.linspace(near * FINE, near * FINE + rest, max(1, math.ceil(rest / STEP)) + 1)
    fine = FINE * np.arange(near)
    return np.concatenate([fine, middle, seconds - fine[::-1]])


def steady_sample(state: FilterState, turn: float = 0.0) -> tuple[Array, Array]:
    """Return the specific force and angular rate (3,), body axes, m/s² and rad/s, that the sensors
    would measure if the vehicle kept its speed and attitude but for a turn (rad/s) about the
    vertical, biases included (Groves 2013, eqs. 5.53 and 5.64 for that motion)."""
    latitude, _, height = state.position
    velocity = state.velocity * [1.0, 1.0, 0.0]
    north, east = metres_per_radian(latitude, height)
    s, c = math.sin(latitude), math.cos(latitude)
    v_north, v_east = velocity[:2]
    eastward = v_east / east  # change of the longitude
    earth = EARTH_RATE * np.array([c, 0.0, -s])
    transport = np.array([eastward * c, -v_north / north, -eastward * s])
    own = np.array([0.0, 0.0, turn])
    gravity = np.array([0.0, 0.0, normal_gravity_at(s, height)])
    to_body = matrix(state.attitude).T
    force = to_body @ (np.cross(2.0 * earth + transport + own, velocity) - gravity)
    rate = to_body @ (earth + transport + own)
    return force + state.accelerometer_bias, rate + state.gyroscope_bias
