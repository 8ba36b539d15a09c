"""The inverse of the strapdown: which specific force and angular rate an INS must have felt, by
its solution (docs/mathematics.md, section 3.19).

A solution's velocity and attitude at both ends of an interval determine the interval's mean
specific force and angular rate; its position then follows by the strapdown's trapezoid. Run on
these samples from the first state of a solution, `isogal.inertial.strapdown` gives the solution
again: to numerical precision where it made the solution, and otherwise with its position led back
to the solution's over `RETURN`, since another INS integrates in steps of its own. An estimate that
starts elsewhere differs from the solution by the INS's error, and the difference grows by the
error model of inertial navigation, as it would on the readings of the INS's own sensors.

That holds for any attitude, if the same one is used in the inverse and in the start: specific
force in navigation axes is what the solution determines, body axes are only those in which biases
are constant. Where a solution has no attitude that of a level vehicle on its course does."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature, metres_per_radian
from isogal.inertial.preintegration import constant_force
from isogal.inertial.rotations import (
    from_heading,
    from_rotation_vector,
    matrix,
    multiply,
    rotate,
    to_angles,
    to_rotation_vector,
)
from isogal.inertial.strapdown import MEANS, ROTATIONS, step

ROUNDS = 6
"""Steps of the iteration: the step of the strapdown is the rotation and the velocity increment
themselves but for terms of the Earth's rotation, 1e-4 of them a second, so each round gains at
least three digits in steps of up to ten seconds."""
RETURN = 10.0
"""s, over which the strapdown's position returns to the solution's. It averages the last digit of
a position over as long, and lags behind a turn, within which the trapezoid is wrong by v w² T² /
12 (2 mm/s at 20 m/s and 0.03 rad/s, T = 1 s), by that times as long: 2 cm."""
SHORTEST_RETURN = 4.0
"""Intervals, for the same."""
LONGEST_STEP = 10.0
"""s, longest interval of one sample."""
NO_COURSE = 0.5
"""m/s of speed below which a velocity has no course: the attitude stays as it was."""
COLUMNS = 10
"""Of a solution: latitude, longitude (rad), height (m), velocity NED (m/s), quaternion body to
NED."""


@kernel(error_model="numpy")
def _solve(
    start: Array, velocity: Array, attitude: Array, dt: float, coning: float, sample: Array
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Find the sample (6,) that takes a state (10,) to a velocity (3,) and an attitude (4,) by one
    step, and return where it leads: position, velocity, attitude."""
    place = (start[0], start[1], start[2])
    speed = (start[3], start[4], start[5])
    qw, qx, qy, qz = start[6], start[7], start[8], start[9]
    first = (qw, qx, qy, qz)
    tw, tx, ty, tz = multiply(
        attitude[0], attitude[1], attitude[2], attitude[3], qw, -qx, -qy, -qz
    )
    turn = to_rotation_vector(tw, tx, ty, tz)
    a, u = np.array(turn), np.zeros(3)
    s, c, end = np.sin(start[0]), np.cos(start[0]), (place, speed, first)
    for k in range(ROUNDS):
        f = rotate(qw, -qx, -qy, -qz, u[0] / dt, u[1] / dt, u[2] / dt)
        w = rotate(qw, -qx, -qy, -qz, a[0] / dt, a[1] / dt, a[2] / dt)
        end = step(s, c, place, speed, first, f, w, (0.0, 0.0, 0.0), dt, coning)
        for i in range(3):
            sample[i], sample[3 + i] = f[i], w[i]
        if k + 1 < ROUNDS:
            _, v, q = end
            bw, bx, by, bz = multiply(q[0], q[1], q[2], q[3], qw, -qx, -qy, -qz)
            b = to_rotation_vector(bw, bx, by, bz)
            left = np.array([velocity[0] - v[0], velocity[1] - v[1], velocity[2] - v[2]])
            du = constant_force(a, left)
            for i in range(3):
                u[i] += du[i]
                a[i] += turn[i] - b[i]
    return end


@kernel(error_model="numpy")
def _advance(state: Array, solution: Array, dt: float, coning: float, sample: Array) -> None:
    """Find the sample (6,) of an interval that ends at a solution (10,), and set the state (10,)
    to what the strapdown makes of it."""
    velocity, attitude = solution[3:6].copy(), solution[6:10]
    place, speed, turned = _solve(state, velocity, attitude, dt, coning, sample)
    m, n = curvature(np.sin(place[0]))
    lon = solution[1] - place[1]
    lon -= 2.0 * np.pi * np.round(lon / (2.0 * np.pi))
    north = (solution[0] - place[0]) * (m + place[2])
    east = lon * (n + place[2]) * np.cos(place[0])
    down = place[2] - solution[2]
    back = max(RETURN, SHORTEST_RETURN * dt)
    velocity[0] += north / back
    velocity[1] += east / back
    velocity[2] += down / back
    place, speed, turned = _solve(state, velocity, attitude, dt, coning, sample)
    for i in range(3):
        state[i], state[3 + i] = place[i], speed[i]
    for i in range(4):
        state[6 + i] = turned[i]


@kernel(error_model="numpy")
def _invert(solution: Array, dt: float, coning: float, samples: Array) -> None:
    """Write the samples (R, K, 6) of solutions (R, K + 1, 10)."""
    for r in range(solution.shape[0]):
        state = solution[r, 0].copy()
        for k in range(samples.shape[1]):
            _advance(state, solution[r, k + 1], dt, coning, samples[r, k])


def inverse(solution: Array, dt: float, preintegrated: bool = False) -> tuple[Array, Array]:
    """Return the means of specific force (R, K, 3; m/s²) and angular rate (R, K, 3; rad/s), body
    axes, that lead the strapdown along a solution.

    Parameters
    ----------
    solution : (R, K + 1, 10) array
        `COLUMNS`, at the ends of K intervals.
    dt : float
        Interval, s.
    preintegrated : bool
        As for `isogal.inertial.strapdown.propagate`, which they are for.
    """
    samples = np.empty((solution.shape[0], solution.shape[1] - 1, 6))
    coning = ROTATIONS if preintegrated else MEANS
    _invert(np.ascontiguousarray(solution, dtype=float), dt, coning, samples)
    return samples[..., :3].copy(), samples[..., 3:].copy()


@dataclass(frozen=True, slots=True, eq=False)
class Felt:
    """What an INS felt over an interval."""

    force: Array
    """(3,) m/s², body axes."""
    rate: Array
    """(3,) rad/s."""
    interval: float
    """s."""


class NothingFeltError(ValueError):
    """Why a solution does not say what the INS felt."""


class InverseStrapdown:
    """Makes samples of solutions as they come, at whatever times.

    Where solutions are missing nothing is lost but the path between: the INS went on, and tells
    where it has come. The time is filled in by the smoothest path between the two.

    Parameters
    ----------
    jump : float
        By how much (m) a position may miss what the velocity says of a second; beyond it the INS
        has set itself anew. Of a longer interval it may miss more, by the square of its length, as
        the trapezoid does.
    longest : float
        s, longest time without solutions that is filled in.
    preintegrated : bool
        As for `inverse`.
    """

    def __init__(self, jump: float, longest: float, preintegrated: bool = False) -> None:
        self._jump, self._longest = jump, longest
        self._coning = ROTATIONS if preintegrated else MEANS
        self._time, self._state, self._last = 0.0, np.full(COLUMNS, np.nan), np.empty(0)

    @property
    def last(self) -> Array | None:
        """The newest solution (10,); None = none yet."""
        return self._last if self._last.size else None

    def take(self, time: float, solution: Array) -> list[Felt]:
        """Take a solution (10,; `COLUMNS`) of a time (s) later than the last; return what the INS
        felt since, in order of time; nothing of the first.

        Raises
        ------
        NothingFeltError
            It is exactly the last one, of an INS that moves, and not taken: the next says what was
            felt since the last one that was. Or it comes after too long a time, or its position
            has jumped: then the next says what is felt from here on.
        """
        if not self._last.size:
            self._begin(time, solution)
            return []
        dt = time - self._time
        if np.array_equal(solution, self._last) and np.hypot(*solution[3:5]) > NO_COURSE:
            raise NothingFeltError("is the one before once more, of an INS that moves")
        if dt > self._longest:
            self._begin(time, solution)
            raise NothingFeltError(f"is {dt:.0f} s after the one before, too long to fill in")
        step, metres = _step(self._last, solution)
        by_velocity = 0.5 * dt * (self._last[3:6] + solution[3:6])
        missed = float(np.linalg.norm(step * metres - by_velocity))
        if missed > self._jump * max(1.0, dt * dt):
            self._begin(time, solution)
            raise NothingFeltError(
                f"position has jumped by {missed:.1f} m: the INS has set itself anew (ins.jump"
                f" is {self._jump:g} m)"
            )
        parts = max(1, math.ceil(dt / LONGEST_STEP))
        found, part = [], dt / parts
        for row in between(self._last, solution, dt, parts):
            sample = np.empty(6)
            _advance(self._state, row, part, self._coning, sample)
            found.append(Felt(sample[:3], sample[3:], part))
        self._time, self._last = time, solution.copy()
        return found

    def _begin(self, time: float, solution: Array) -> None:
        self._time, self._state, self._last = time, solution.copy(), solution.copy()


def _step(before: Array, after: Array) -> tuple[Array, Array]:
    """Return (3,) by how much a solution's position changes, rad, rad, m, and (3,) how many metres
    north, east and down one of each is."""
    step = after[:3] - before[:3]
    step[1] -= 2.0 * np.pi * np.round(step[1] / (2.0 * np.pi))
    north, east = metres_per_radian(0.5 * (before[0] + after[0]), 0.5 * (before[2] + after[2]))
    return step, np.array([north, east, -1.0])


def between(before: Array, after: Array, dt: float, parts: int) -> Array:
    """Return (parts, 10) solutions at the ends of equal parts of a time (s), the last of which is
    the one after it: the cubic through both positions with both velocities, a constant turn."""
    t = np.arange(1, parts + 1)[:, None] / parts
    step, metres = _step(before, after)
    v0, v1, mean = before[3:6] / metres, after[3:6] / metres, step / dt
    place = before[:3] + dt * t * (
        v0 + t * (3.0 * mean - 2.0 * v0 - v1) + t * t * (v0 + v1 - 2.0 * mean)
    )
    speed = v0 + 2.0 * t * (3.0 * mean - 2.0 * v0 - v1) + 3.0 * t * t * (v0 + v1 - 2.0 * mean)
    w, x, y, z = before[6:]
    turn = np.array(to_rotation_vector(*multiply(*after[6:], w, -x, -y, -z)))
    turned = [multiply(*from_rotation_vector(*(share * turn)), w, x, y, z) for share in t[:, 0]]
    rows = np.concatenate([place, speed * metres, turned], axis=1)
    rows[-1] = after
    return rows


def level_attitude(velocity: Array, before: Array | None = None) -> Array:
    """Return the attitude (N, 4) of a level vehicle on its course.

    Parameters
    ----------
    velocity : (N, 3) array
        NED, m/s, one after the other.
    before : (4,) array, optional
        The attitude before the first: of one that is too slow to have a course. Default: north.
    """
    moves = np.hypot(velocity[:, 0], velocity[:, 1]) >= NO_COURSE
    first = 0.0 if before is None else to_angles(matrix(before))[2]
    course = np.concatenate([[first], np.arctan2(velocity[:, 1], velocity[:, 0])])
    last = np.maximum.accumulate(np.where(moves, np.arange(1, len(velocity) + 1), 0))
    return from_heading(course[last])
