"""The navigator's linear error model (`isogal.inertial.error_model`) along a trajectory: geometry,
and covariance at the start."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import radii
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.inertial.error_state import batch_covariance
from isogal.inertial.rotations import matrix
from isogal.scenario import Imu, ImuErrors, InitialError
from isogal.sensors.imu_model import bias_sigma, noise_density
from isogal.sensors.trajectory import Trajectory

LONGEST = 1.0
"""s, duration of a stretch at most. Errors change over minutes (Schuler period 84 min), so
stretches of a second are short enough for an IMU of any rate."""
_TOGETHER = 500
"""Stretches whose transitions are in memory at once."""


class Segments(NamedTuple):
    """What the model needs at the middle of each of S stretches of the trajectory, all of the same
    duration."""

    geometry: Array
    """(S, 5) latitude (rad), north and east velocity (m/s), 1 / (M + h), 1 / (N + h) (1/m)."""
    force: Array
    """(S, 3) specific force, NED, m/s²."""
    rotation: Array
    """(S, 3, 3) body to NED."""
    rate: Array
    """(S, 3) angular rate, body, rad/s."""
    dt: float
    """s, duration of a stretch."""
    per_scan: int
    """Stretches from one gravimeter reading to the next."""


def divide(trajectory: Trajectory, steps_per_scan: int) -> Segments:
    """Divide a trajectory into stretches of whole IMU intervals, up to `LONGEST` where an interval
    is shorter. What is left of the trajectory after the last whole scan, of so many intervals, is
    dropped."""
    size = max(
        n
        for n in range(1, steps_per_scan + 1)
        if steps_per_scan % n == 0 and (n == 1 or n * trajectory.dt <= LONGEST)
    )
    count = len(trajectory) // steps_per_scan * (steps_per_scan // size)
    ends = np.arange(count + 1) * size

    def middle(values: Array) -> Array:
        return 0.5 * (values[ends[:-1]] + values[ends[1:]])

    every = trajectory.latitude, trajectory.velocity, trajectory.height
    latitude, velocity, height = map(middle, every)
    rotation = middle(matrix(trajectory.attitude))

    def mean(values: Array) -> Array:
        return np.asarray(values[: count * size].reshape(count, size, 3).mean(axis=1))

    meridian, normal = radii(latitude)
    geometry = np.stack(
        [latitude, velocity[:, 0], velocity[:, 1], 1 / (meridian + height), 1 / (normal + height)],
        axis=1,
    )
    return Segments(
        geometry,
        np.einsum("sij,sj->si", rotation, mean(trajectory.specific_force)),
        rotation,
        mean(trajectory.angular_rate),
        size * trajectory.dt,
        steps_per_scan // size,
    )


def initial_covariance(
    sigma: InitialError, sensors: ImuErrors, auxiliary: Sequence[AuxiliaryState] = ()
) -> Array:
    """Return the covariance (13 + M, 13 + M) of the error at the start: initial errors, biases of
    the IMU, and auxiliary states."""
    start = batch_covariance(sigma.position, sigma.velocity, sigma.tilt, sigma.heading)
    more = np.square([*bias_sigma(sensors), *(state.sigma for state in auxiliary)])
    return np.diag([*np.diag(start), *more])


def ageing(segments: Segments, states: Sequence[AuxiliaryState]) -> tuple[Array, Array]:
    """Return what becomes of auxiliary states over each stretch.

    Returns
    -------
    correlation : (S, M) array
        Of each state at the two ends of a stretch.
    half_noise : (S, M) array
        Half of the variance that comes in, for half of it at either end: c² (P + q) + q keeps a
        steady variance P.
    """
    distance = np.hypot(segments.geometry[:, 1], segments.geometry[:, 2]) * segments.dt
    time, length, sigma, walk = np.array(
        [(one.time, one.length, one.sigma, one.walk) for one in states]
    ).T.reshape(4, -1)
    c = np.exp(-segments.dt / time - distance[:, None] / length)
    return c, sigma**2 * (1.0 - c**2) / (1.0 + c**2) + 0.5 * walk**2 * segments.dt


def transitions(
    segments: Segments, imu: Imu, states: Sequence[AuxiliaryState]
) -> Iterator[tuple[Array, Array]]:
    """Yield transition and half of the process noise, (13 + M, 13 + M) each, of one stretch after
    the other, for the navigator's errors and auxiliary states.

    A covariance goes over a stretch as T (P + q) T' + q: the trapezoid rule, by which half of the
    noise enters at either end."""
    density = np.square(noise_density(imu.sensors, 1.0 / imu.rate))
    correlation, half_noise = ageing(segments, states)
    for first in range(0, len(correlation), _TOGETHER):
        part = slice(first, first + _TOGETHER)
        F = _dynamics(segments, part, states)
        transition = segments.dt * F + 0.5 * segments.dt**2 * (F @ F)
        transition += np.eye(F.shape[1])
        half = np.zeros_like(F)
        rotation = segments.rotation[part]
        for at, densities in ((slice(2, 4), density[:3]), (slice(4, 7), density[3:])):
            axes = rotation[:, : at.stop - at.start]  # velocity is the horizontal one
            half[:, at, at] = 0.5 * segments.dt * (axes * densities) @ axes.transpose(0, 2, 1)
        own = np.arange(STATES, F.shape[1])
        transition[:, own, own], half[:, own, own] = correlation[part], half_noise[part]
        yield from zip(transition, half, strict=True)


def _dynamics(segments: Segments, part: slice, states: Sequence[AuxiliaryState]) -> Array:
    """Return F (B, 13 + M, 13 + M) of dx/dt = F x in some stretches, but for what becomes of
    auxiliary states themselves."""
    geometry, force, rotation, rate = (one[part] for one in segments[:4])
    F = np.zeros((len(geometry), STATES + len(states), STATES + len(states)))
    for one in zip(F, geometry, force, rotation, strict=True):
        fill_dynamics(*one)
    sensed = np.concatenate([np.einsum("sij,si->sj", rotation, force), rate], axis=1)
    for at, state in enumerate(states, STATES):
        row, share = state.input
        size = sensed[:, share - 1] if share else 1.0
        if row >= 6:
            F[:, 4:7, at] = (rotation[..., row - 6].T * size).T
        elif row >= 3:
            F[:, 2:4, at] = (rotation[:, :2, row - 3].T * size).T
        elif row in (0, 1):
            F[:, 2 + row, at] = 1.0
    return F
