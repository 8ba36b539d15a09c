"""Strapdown and filter in plain NumPy, with vectors, rotation matrices and `numpy.linalg`: written
after the books, not after the compiled functions."""

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints
from scipy.spatial.transform import Rotation

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE, radii
from isogal.earth.gravity import normal_gravity


@dataclass
class State:
    """P points: position (P, 3) rad, rad, m; velocity (P, 3) NED; attitude (P, 3, 3) body to
    NED."""

    position: Array
    velocity: Array
    attitude: Array


def _rates(latitude: Array, height: Array, velocity: Array) -> tuple[Array, Array]:
    """Earth rate and transport rate (P, 3), NED, rad/s (Groves 2013, eqs. 5.41, 5.44)."""
    meridian, normal = radii(latitude)
    earth = EARTH_RATE * np.stack([np.cos(latitude), 0 * latitude, -np.sin(latitude)], axis=-1)
    north, east = velocity[:, 0] / (meridian + height), velocity[:, 1] / (normal + height)
    return earth, np.stack([east, -north, -east * np.tan(latitude)], axis=-1)


def strapdown(state: State, force: Array, rate: Array, dt: float) -> State:
    """One interval for P points with mean specific force and angular rate (P, 3), body axes."""
    latitude, longitude, height = state.position.T
    u = np.einsum("pij,pj->pi", state.attitude, force) * dt
    a = np.einsum("pij,pj->pi", state.attitude, rate) * dt
    down = np.array([0.0, 0.0, 1.0])

    earth, transport = _rates(latitude, height, state.velocity)
    coriolis = np.cross(2 * earth + transport, state.velocity)
    middle = state.velocity + 0.5 * (
        u + dt * (normal_gravity(latitude, height)[:, None] * down - coriolis)
    )
    mean_velocity = 0.5 * (state.velocity + middle)
    half_way = latitude + 0.5 * dt * mean_velocity[:, 0] / (radii(latitude)[0] + height)
    height_half_way = height - 0.5 * dt * mean_velocity[:, 2]

    earth, transport = _rates(half_way, height_half_way, middle)
    z = (earth + transport) * dt
    au, zu = np.cross(a, u), np.cross(z, u)
    increment = u + 0.5 * (au - zu) + (np.cross(a, au) + np.cross(z, zu)) / 6 - np.cross(z, au) / 3
    gravity = normal_gravity(half_way, height_half_way)[:, None] * down
    velocity = (
        state.velocity + increment + dt * (gravity - np.cross(2 * earth + transport, middle))
    )

    moved = 0.5 * dt * (state.velocity + velocity)
    meridian, normal = radii(half_way)
    position = np.stack(
        [
            latitude + moved[:, 0] / (meridian + height_half_way),
            longitude + moved[:, 1] / ((normal + height_half_way) * np.cos(half_way)),
            height - moved[:, 2],
        ],
        axis=-1,
    )
    az = np.cross(a, z)
    attitude = (
        Rotation.from_rotvec(a - z + az / 2 - np.cross(a, az) / 6).as_matrix() @ state.attitude
    )
    return State(position, velocity, attitude)


def add(state: State, error: Array) -> State:
    """Move one state (P = 1) by P error states (P, 9)."""
    latitude, _, height = state.position[0]
    meridian, normal = radii(latitude)
    metres = np.array([meridian + height, (normal + height) * np.cos(latitude), -1.0])
    attitude = Rotation.from_rotvec(error[:, 6:9]).as_matrix() @ state.attitude[0]
    return State(state.position + error[:, :3] / metres, state.velocity + error[:, 3:6], attitude)


def subtract(states: State, centre: State) -> Array:
    """(P, 9) error states that lead from one state to P states."""
    latitude, _, height = centre.position[0]
    meridian, normal = radii(latitude)
    metres = np.array([meridian + height, (normal + height) * np.cos(latitude), -1.0])
    turn = Rotation.from_matrix(states.attitude @ centre.attitude[0].T).as_rotvec()
    return np.concatenate(
        [(states.position - centre.position) * metres, states.velocity - centre.velocity, turn],
        axis=1,
    )


def predict(
    state: State,
    bias: Array,
    covariance: Array,
    force: Array,
    rate: Array,
    dt: float,
    noise: Array,
    parameters: tuple[float, float, float],
) -> tuple[State, Array, Array]:
    """One interval of the unscented filter for one run (P = 1), sigma points and weights by
    filterpy.

    `bias` (6,) of accelerometers and gyroscopes, `noise` (6,) their densities, `parameters` alpha,
    beta, kappa. Returns state, bias and covariance (15, 15)."""
    points = MerweScaledSigmaPoints(15, *parameters)
    errors = points.sigma_points(np.zeros(15), covariance)
    moved = add(state, errors[:, :9])
    sensed = np.concatenate([force, rate]) - bias - errors[:, 9:]
    ends = strapdown(moved, sensed[:, :3], sensed[:, 3:], dt)
    centre = State(ends.position[:1], ends.velocity[:1], ends.attitude[:1])
    errors = np.concatenate([subtract(ends, centre), errors[:, 9:]], axis=1)
    mean = points.Wm @ errors
    spread = errors - mean
    Q = np.zeros((15, 15))
    axes = centre.attitude[0]
    Q[3:6, 3:6] = axes @ np.diag(noise[:3] ** 2 * dt) @ axes.T
    Q[6:9, 6:9] = axes @ np.diag(noise[3:] ** 2 * dt) @ axes.T
    return add(centre, mean[None, :9]), bias + mean[9:], (spread.T * points.Wc) @ spread + Q


def update_height(
    state: State, bias: Array, covariance: Array, height: float, sigma: float
) -> tuple[State, Array, Array]:
    """Kalman update of one run with a known height, by the textbook formula."""
    H = np.zeros((1, 15))
    H[0, 2] = 1.0  # down error
    gain = covariance @ H.T / (H @ covariance @ H.T + sigma**2)
    error = (gain * (state.position[0, 2] - height))[:, 0]
    return add(state, error[None, :9]), bias + error[9:], (np.eye(15) - gain @ H) @ covariance
