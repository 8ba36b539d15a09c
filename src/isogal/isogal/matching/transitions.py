"""What the navigator's error at the end of a batch says of its error at each scan: linear
dynamics, what of it the unknown explains, and times without inertial data (docs/mathematics.md,
sections 4.2 to 4.4 and 4.8)."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature
from isogal.earth.gravity import normal_gravity_at
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.inertial.error_state import BATCH_STATES
from isogal.matrices import square_root, symmetric


def backwards(latitude: Array, velocity: Array, times: Array, end: float) -> Array:
    """Return (T, 7, 7): the error at each scan per unit of error at time `end`, by the navigator's
    linear error dynamics; without IMU noise, 0.3 m in 300 s for the precision grade."""
    return np.asarray(_chain(latitude, np.ascontiguousarray(velocity), times, end))


@dataclass(frozen=True, slots=True, eq=False)
class Bridge:
    """The end of a time without inertial data, in which the motion of the vehicle is unknown: the
    navigator's error before it, given that after it, x, is N(gain x, root root')."""

    time: float
    """s; scans before belong to the other side, those within the gap too."""
    gain: Array
    """(7, 7)."""
    root: Array
    """(7, 7)."""

    @classmethod
    def of(cls, time: float, before: Array, after: Array) -> "Bridge":
        """Return the bridge of a navigator whose covariance (7, 7) at a time would have been
        `before`, had the vehicle moved as the navigator took it to, and is `after`.

        The gain of the fixed-interval smoother (Rauch, Tung & Striebel 1965, AIAA J. 3:1445)."""
        scale = np.sqrt(np.diag(after))
        unit = scale[:, None] * scale
        gain = np.linalg.solve(after / unit, before / unit).T
        rest = symmetric(before / unit - gain @ (before / unit))
        return cls(time, gain * scale[:, None] / scale, scale[:, None] * square_root(rest))


def carried(covariance: Array, at: tuple[float, Array, float], end: float) -> Array:
    """Return a covariance (7, 7) of a latitude (rad), velocity (2,) and time (s) as it is at a
    later time (s), the inertial sensors being exact."""
    latitude, velocity, begin = at
    back = backwards(np.array([latitude]), velocity[None], np.array([begin]), end)[0]
    forward = np.linalg.inv(back)
    return symmetric(forward @ covariance @ forward.T)


def across(
    bridge: Bridge | None, plain: Array, latitude: Array, velocity: Array, times: Array, end: float
) -> tuple[Array, Array]:
    """Return (T, 7, 7) the errors at scans per unit of error at the end, with a gap in the
    inertial data between them, and (T, 7, K) what they are beside that, per unit-variance
    component of K.

    Parameters
    ----------
    bridge : Bridge, optional
        None = there was no gap.
    plain : (T, 7, 7) array
        Of `backwards`.
    latitude, velocity, times : (T,), (T, 2), (T,) arrays
        Of the scans; rad, m/s, s.
    end : float
        s.
    """
    before = np.zeros(len(times), bool) if bridge is None else times < bridge.time
    if bridge is None or not before.any() or bridge.time > end:
        return plain, np.zeros((len(times), BATCH_STATES, 0))
    after = min(int(before.sum()), len(times) - 1)
    until = float(times[after]) if not before[after] else end
    step = backwards(latitude[[after]], velocity[[after]], np.array([bridge.time]), until)[0]
    at_bridge = step if before[after] else step @ plain[after]
    to_bridge = plain[before] @ np.linalg.inv(at_bridge)
    every, rest = plain.copy(), np.zeros((len(times), BATCH_STATES, bridge.root.shape[1]))
    every[before] = to_bridge @ bridge.gain @ at_bridge
    rest[before] = to_bridge @ bridge.root
    return every, rest


@kernel
def rates(values: Array, times: Array) -> Array:
    """Return (T, n) how fast values (T, n) change at times (T,), to second order in between
    (Fornberg 1988, Math. Comp. 51:699); zero of a single one."""
    count = times.shape[0]
    out = np.zeros(values.shape)
    for t in range(count if count > 1 else 0):
        first, last = max(t - 1, 0), min(t + 1, count - 1)
        before, after = times[t] - times[first], times[last] - times[t]
        for i in range(values.shape[1]):
            if t in (first, last):
                out[t, i] = (values[last, i] - values[first, i]) / (before + after)
            else:
                left = (values[t, i] - values[first, i]) / before
                right = (values[last, i] - values[t, i]) / after
                out[t, i] = (left * after + right * before) / (before + after)
    return out


@kernel
def _chain(latitude: Array, velocity: Array, times: Array, end: float) -> Array:
    """Multiply up the transitions from the end to each scan, each exp(-F step) to third order."""
    count, n = times.shape[0], BATCH_STATES
    change = rates(velocity, times)
    geometry, force = np.empty(5), np.empty(3)
    result = np.empty((count, n, n))
    following, term, more = np.zeros((n, n)), np.empty((n, n)), np.empty((n, n))
    dynamics = np.zeros((STATES, STATES))
    no_rotation = np.zeros((3, 3))  # biases are not among the seven states
    for a in range(n):
        following[a, a] = 1.0
    for i in range(count - 1, -1, -1):
        sine, step = math.sin(latitude[i]), (times[i + 1] if i + 1 < count else end) - times[i]
        meridian, normal = curvature(sine)
        geometry[0], geometry[1], geometry[2] = latitude[i], velocity[i, 0], velocity[i, 1]
        geometry[3], geometry[4] = 1.0 / meridian, 1.0 / normal
        force[0], force[1] = change[i, 0], change[i, 1]
        force[2] = -normal_gravity_at(sine, 0.0)
        fill_dynamics(dynamics, geometry, force, no_rotation)
        for a in range(n):
            for b in range(n):
                term[a, b] = following[a, b]
        for order in range(1, 4):
            for a in range(n):
                for b in range(n):
                    more[a, b] = 0.0
                for c in range(n):
                    factor = -step * dynamics[a, c] / order
                    if factor != 0.0:  # two thirds are
                        for b in range(n):
                            more[a, b] += factor * term[c, b]
            for a in range(n):
                for b in range(n):
                    term[a, b] = more[a, b]
                    following[a, b] += more[a, b]
        for a in range(n):  # a slice would take seconds to compile
            for b in range(n):
                result[i, a, b] = following[a, b]
    return result


def given_position_and_velocity(
    by_error: Array, covariance: Array, apart: Array
) -> tuple[Array, Array]:
    """Split what x ~ N(0, covariance) does to rows, `by_error` (T, R, 7), into what xi = x[:4]
    explains and the rest.

    The attitude given xi is A xi + e with e ~ N(0, S). Returns (T, R, 4) per unit of xi, and
    (T, R, 3 + K) per unit-variance component of e and of what is beside x, `apart` (T, R, K).
    """
    gain = np.linalg.solve(covariance[:4, :4], covariance[:4, 4:]).T
    root = square_root(covariance[4:, 4:] - gain @ covariance[:4, 4:])
    attitude = by_error[:, :, 4:]
    rest = np.concatenate([attitude @ root, apart], axis=2)
    return by_error[:, :, :4] + attitude @ gain, rest
