"""A satellite receiver on the simulated vehicle, and what somebody makes it believe
(docs/mathematics.md, section 3.14)."""

import math
from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.inertial.rotations import matrix
from isogal.scenario import Deception, Gnss
from isogal.seeds import generator
from isogal.sensors.position_aid import (
    AidReadings,
    aid_index,
    curvilinear,
    with_errors,
    within,
)
from isogal.sensors.trajectory import Trajectory


def simulate_satellites(
    gnss: Gnss, trajectory: Trajectory, seed: int, runs: Sequence[int]
) -> tuple[AidReadings, AidReadings]:
    """Return what the receivers of some runs give of their antennas, NaN without satellites:
    latitude, longitude (rad) and height (m), (R, M, 3); and the velocity (R, M, 3) m/s, NED."""
    aid = gnss.positions
    index = aid_index(aid.interval, trajectory)
    offset, velocity = at_arm(trajectory, gnss.lever_arm)
    true = trajectory.position + curvilinear(trajectory, offset)
    places = np.empty((len(runs), len(index), 3))
    velocities = np.empty_like(places)
    for k, run in enumerate(runs):
        angle = generator(seed, run, "gnss_deception").uniform(0.0, 2.0 * math.pi)
        direction = np.array([math.cos(angle), math.sin(angle), 0.0])
        place, speed = _believed(gnss.deception, trajectory, true, velocity, direction)
        noise = generator(seed, run, "gnss_velocity").standard_normal(places[k].shape)
        places[k] = place[index]
        velocities[k] = speed[index] + (gnss.velocity_sigma or np.nan) * noise * aid.unequal
    positions = with_errors(aid, trajectory, index, places, seed, runs)
    hidden = ~within(gnss.available or (), trajectory.time[index] - trajectory.time[0])
    positions[:, hidden], velocities[:, hidden] = np.nan, np.nan
    return AidReadings(index, positions), AidReadings(index, velocities)


def turn_rates(trajectory: Trajectory) -> Array:
    """Return the angular rate (K + 1, 3), body axes, rad/s, of both steps that meet; the Earth's
    rotation in it is 0.1 mm/s for a metre of arm."""
    rate = trajectory.angular_rate
    return 0.5 * (np.concatenate([rate[:1], rate]) + np.concatenate([rate, rate[-1:]]))


def at_arm(trajectory: Trajectory, arm: tuple[float, float, float]) -> tuple[Array, Array]:
    """Return offset (K + 1, 3) m and velocity (K + 1, 3) m/s, NED, of a sensor at a lever arm (m,
    body axes)."""
    to_ned = matrix(trajectory.attitude)
    return to_ned @ np.array(arm), trajectory.velocity + np.einsum(
        "kij,kj->ki", to_ned, np.cross(turn_rates(trajectory), arm)
    )


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
    moved = curvilinear(trajectory, away[:, None] * direction)
    place[during] += moved[during]
    return place, velocity
