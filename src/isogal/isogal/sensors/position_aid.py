"""A simulated sensor of the vehicle's position: satellites, acoustics, radar, a person's fix
(docs/mathematics.md, section 3.14)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.rotations import matrix
from isogal.scenario import PositionAid
from isogal.sensors.noise import Noise
from isogal.sensors.trajectory import Trajectory


class AidReadings(NamedTuple):
    """What the sensors of one kind give in R runs, at M times."""

    ends: Integers
    """(M,) the ends of the steps that they are of, counted from 1."""
    values: Array
    """(R, M) or (R, M, 3); NaN = nothing."""


def simulate_positions(
    aid: PositionAid, trajectory: Trajectory, seed: int, runs: Sequence[int]
) -> AidReadings:
    """Return the latitude, longitude (rad) and height (m), (R, M, 3), that an aid as it really is
    gives in some runs."""
    index = aid_index(aid.interval, trajectory)
    offset = matrix(trajectory.attitude[index]) @ np.array(aid.lever_arm)
    measured = trajectory.position[index] + curvilinear(trajectory, offset, index)
    positions = with_errors(aid, trajectory, index, measured, seed, runs)
    positions[:, ~within(aid.available, trajectory.time[index] - trajectory.time[0])] = np.nan
    return AidReadings(index, positions)


def with_errors(
    aid: PositionAid,
    trajectory: Trajectory,
    index: Integers,
    places: Array,
    seed: int,
    runs: Sequence[int],
) -> Array:
    """Return (R, M, 3) places, (M, 3) or (R, M, 3), with the errors of an aid's positions."""
    errors = Noise(
        aid.prefix,
        aid.sigma,
        correlated=aid.correlated_sigma,
        correlation_time=aid.correlation_time,
    )
    time = trajectory.time[index] - trajectory.time[0]
    drawn = [errors.draw(seed, run, time, (3,)) * aid.unequal for run in runs]
    return places + np.array([curvilinear(trajectory, one, index) for one in drawn])


def aid_index(interval: float, trajectory: Trajectory) -> Integers:
    """Return (M,) the ends of the steps at which an aid of an interval (s) measures."""
    step = round(interval / trajectory.dt)
    return np.arange(step, len(trajectory) + 1, step)


def within(times: Sequence[tuple[float, float]] | None, since: Array) -> Booleans:
    """Return (M,) whether times since the start (s) are within those of a list; None = all."""
    seen = np.full(len(since), times is None)
    for begin, end in times or ():
        seen |= (since >= begin) & (since <= end)
    return seen


def curvilinear(trajectory: Trajectory, offset: Array, index: Integers | None = None) -> Array:
    """Return offsets (N, 3), NED, m, of points of a trajectory as latitude, longitude (rad) and
    height (m)."""
    which = slice(None) if index is None else index
    north, east = metres_per_radian(trajectory.latitude[which], trajectory.height[which])
    return offset / np.stack([north, east, np.full_like(north, -1.0)], axis=1)
