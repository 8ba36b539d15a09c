"""A sensor of the vehicle's velocity in body axes: Doppler log, odometer, log, airspeed
(docs/mathematics.md, section 3.12)."""

from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array
from isogal.inertial.rotations import matrix
from isogal.scenario import Truth, Velocity
from isogal.seeds import generator
from isogal.sensors.noise import gauss_markov
from isogal.sensors.position_aid import aid_index
from isogal.sensors.satellites import at_arm
from isogal.sensors.trajectory import Trajectory


def simulate_velocities(truth: Truth, trajectory: Trajectory, runs: Sequence[int]) -> Array:
    """Return (R, K, 3) what the sensor of each run reads at the end of each IMU interval: m/s,
    forward, right, down; NaN in axes that it does not have and where it reads nothing."""
    settings = truth.velocity
    index = aid_index(truth, settings.interval, trajectory)
    velocity = at_arm(trajectory, settings.lever_arm)[1][index]
    to_body = np.swapaxes(matrix(trajectory.attitude[index]), 1, 2)
    ways = np.hypot(velocity[:, 0], velocity[:, 1]) * np.diff(trajectory.time[index], prepend=0.0)
    result = np.full((len(runs), len(trajectory), 3), np.nan)
    axes = list(settings.axes)
    for rows, run in zip(result, runs, strict=True):
        scale, pitch, yaw = generator(truth.seed, run, "velocity_mounting").standard_normal(3)
        noise = generator(truth.seed, run, "velocity_noise").standard_normal((len(index), 3))
        past_flow = velocity - _flow(settings, truth.seed, run, trajectory.time[index], ways)
        body = np.einsum("kij,kj->ki", to_body, past_flow)
        turned = body + settings.number("misalignment") * np.cross(body, [0.0, pitch, yaw])
        read = (1.0 + settings.number("scale") * scale) * turned + settings.number("sigma") * noise
        rows[(index - 1)[:, None], axes] = read[:, axes]
    return result


def _flow(settings: Velocity, seed: int, run: int, time: Array, ways: Array) -> Array:
    """Return (N, 3) the current or wind (m/s, north, east, down) at times (N,), s, before each of
    which the vehicle has gone a way (N,), m."""
    flow = np.zeros((len(time), 3))
    sigma = settings.number("current_sigma")
    if sigma == 0.0:
        return flow
    normal = generator(seed, run, "velocity_current").standard_normal((len(time), 2))
    elapsed = np.diff(time, prepend=0.0)
    keep = np.exp(-elapsed / settings.current_time - ways / settings.current_length)
    flow[:, :2] = sigma * gauss_markov(keep[1:], normal.T).T
    return flow
