"""The strapdown in plain NumPy, with vectors and rotation matrices: written after the books, not
after the compiled functions."""

from dataclasses import dataclass

import numpy as np
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
