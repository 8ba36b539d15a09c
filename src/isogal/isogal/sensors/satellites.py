"""A satellite receiver on the simulated vehicle, and what somebody makes it believe
(docs/mathematics.md, section 3.14)."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.rotations import matrix
from isogal.scenario import Deception, Truth
from isogal.scenario.aids import VERTICAL
from isogal.seeds import generator
from isogal.sensors.noise import Noise
from isogal.sensors.trajectory import Trajectory


class SatelliteFixes(NamedTuple):
    """What the receivers of R runs give at M times."""

    ends: Integers
    """(M,) the ends of the steps that they are of, counted from 1."""
    position: Array
    """(R, M, 3) latitude, longitude (rad), height (m) of the antenna; NaN = no satellites."""
    velocity: Array
    """(R, M, 3) m/s, NED, of the antenna; NaN = none."""


def simulate_satellites(
    truth: Truth, trajectory: Trajectory, runs: Sequence[int]
) -> SatelliteFixes:
    """Return what the receivers of some runs give, by the times that it is of."""
    gnss, step = truth.gnss, truth.steps_per_satellite_fix
    index = np.arange(step, len(trajectory) + 1, step)
    time = trajectory.time[index] - trajectory.time[0]
    seen = np.zeros(len(index), dtype=np.bool_)
    for begin, end in gnss.available or ():
        seen |= (time >= begin) & (time <= end)
    offset, velocity = _antenna(trajectory, gnss.lever_arm)
    offset = _curvilinear(trajectory, offset)
    true = np.stack([trajectory.latitude, trajectory.longitude, trajectory.height], axis=1)
    unequal = np.array([1.0, 1.0, VERTICAL])
    errors = Noise(
        "gnss",
        gnss.position_sigma,
        correlated=gnss.correlated_sigma,
        correlation_time=gnss.correlation_time,
    )
    positions = np.full((len(runs), len(index), 3), np.nan)
    velocities = np.full_like(positions, np.nan)
    for k, run in enumerate(runs):
        places, speeds = _believed(
            gnss.deception, trajectory, true + offset, velocity, _direction(truth.seed, run)
        )
        error = errors.draw(truth.seed, run, time, (3,)) * unequal
        positions[k] = places[index] + _curvilinear(trajectory, error, index)
        noise = generator(truth.seed, run, "gnss_velocity").standard_normal(error.shape)
        velocities[k] = speeds[index] + (gnss.velocity_sigma or np.nan) * noise * unequal
    positions[:, ~seen], velocities[:, ~seen] = np.nan, np.nan
    return SatelliteFixes(index, positions, velocities)


def _antenna(trajectory: Trajectory, arm: tuple[float, float, float]) -> tuple[Array, Array]:
    """Return offset (K + 1, 3) m and velocity (K + 1, 3) m/s, NED, of an antenna at a lever arm
    (m, body axes)."""
    rate = trajectory.angular_rate
    # of both steps that meet; the Earth's rotation is 0.1 mm/s for a metre of arm
    at = 0.5 * (np.concatenate([rate[:1], rate]) + np.concatenate([rate, rate[-1:]]))
    to_ned = matrix(trajectory.attitude)
    return to_ned @ np.array(arm), trajectory.velocity + np.einsum(
        "kij,kj->ki", to_ned, np.cross(at, arm)
    )


def _curvilinear(trajectory: Trajectory, offset: Array, index: Integers | None = None) -> Array:
    """Return offsets (N, 3), NED, m, of points of a trajectory as latitude, longitude (rad) and
    height (m)."""
    which = slice(None) if index is None else index
    north, east = metres_per_radian(trajectory.latitude[which], trajectory.height[which])
    return offset / np.stack([north, east, np.full_like(north, -1.0)], axis=1)


def _direction(seed: int, run: int) -> Array:
    """Return a random horizontal direction (3,), NED."""
    angle = generator(seed, run, "gnss_deception").uniform(0.0, 2.0 * math.pi)
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def _believed(
    deception: Deception, trajectory: Trajectory, place: Array, velocity: Array, direction: Array
) -> tuple[Array, Array]:
    """Return position (K + 1, 3) and velocity (K + 1, 3) that a deceived receiver has without its
    own errors."""
    time = trajectory.time - trajectory.time[0]
    since = time - deception.start
    during: Booleans = (since >= 0.0) & (time <= (deception.end or np.inf))
    if deception.kind == "none" or not during.any():
        return place, velocity
    place, velocity = place.copy(), velocity.copy()
    if deception.kind == "delay":
        then = time[during] - deception.size
        for values in (place, velocity):
            values[during] = np.stack(
                [np.interp(then, time, column) for column in values.T], axis=1
            )
        return place, velocity
    away = np.full(len(time), deception.size)
    if deception.kind == "walk":
        away = deception.rate * since
        velocity[during] += deception.rate * direction
    moved = _curvilinear(trajectory, away[:, None] * direction)
    place[during] += moved[during]
    return place, velocity
