"""A sensor of the vehicle's velocity in body axes: Doppler log, odometer, log, airspeed
(docs/mathematics.md, section 3.12)."""

from collections.abc import Callable, Sequence

import numpy as np

from isogal.arrays import Array
from isogal.inertial.rotations import matrix
from isogal.scenario import Velocity
from isogal.seeds import generator
from isogal.sensors.noise import gauss_markov
from isogal.sensors.position_aid import AidReadings, aid_index
from isogal.sensors.satellites import at_arm
from isogal.sensors.trajectory import Trajectory


def simulate_velocities(
    settings: Velocity,
    trajectory: Trajectory,
    seed: int,
    runs: Sequence[int],
    every: Sequence[Velocity],
) -> AidReadings:
    """Return what a sensor as it really is reads in each run, (R, M, 3): m/s, forward, right,
    down; NaN in axes that it does not have.

    Parameters
    ----------
    settings : Velocity
    trajectory : Trajectory
    seed : int
    runs : sequence of int
    every : sequence of Velocity
        All sensors of the velocity: one current or wind is drawn for those in the same medium.
    """
    index = aid_index(settings.interval, trajectory)
    velocity = at_arm(trajectory, settings.lever_arm)[1][index]
    to_body = np.swapaxes(matrix(trajectory.attitude[index]), 1, 2)
    result = np.full((len(runs), len(index), 3), np.nan)
    axes, prefix = list(settings.axes), settings.prefix
    first = next(one for one in every if one.medium == settings.medium)
    for rows, run in zip(result, runs, strict=True):
        scale, pitch, yaw = generator(seed, run, f"{prefix}_mounting").standard_normal(3)
        noise = generator(seed, run, f"{prefix}_noise").standard_normal((len(index), 3))
        flow = _flow(first, trajectory, seed, run)
        past_flow = velocity - flow(trajectory.time[index])
        body = np.einsum("kij,kj->ki", to_body, past_flow)
        turned = body + settings.number("misalignment") * np.cross(body, [0.0, pitch, yaw])
        read = (1.0 + settings.number("scale") * scale) * turned + settings.number("sigma") * noise
        rows[:, axes] = read[:, axes]
    return AidReadings(index, result)


def _flow(
    settings: Velocity, trajectory: Trajectory, seed: int, run: int
) -> Callable[[Array], Array]:
    """Return what gives the current or wind (N, 3) m/s, north, east, down, at times (N,), s: drawn
    at those of the first sensor in a medium, and linear between them for the others."""
    sigma = settings.number("current_sigma")
    if sigma == 0.0:
        return lambda time: np.zeros((len(time), 3))
    index = aid_index(settings.interval, trajectory)
    time, velocity = trajectory.time[index], at_arm(trajectory, settings.lever_arm)[1][index]
    stream = generator(seed, run, f"{settings.prefix}_current")
    normal = stream.standard_normal((len(time), 2))
    elapsed = np.diff(time, prepend=0.0)
    ways = np.hypot(velocity[:, 0], velocity[:, 1]) * elapsed
    keep = np.exp(-elapsed / settings.current_time - ways / settings.current_length)
    flow = sigma * gauss_markov(keep[1:], normal.T)
    return lambda at: np.stack([*(np.interp(at, time, one) for one in flow), 0.0 * at], axis=1)
