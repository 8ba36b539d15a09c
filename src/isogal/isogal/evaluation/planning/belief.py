"""The navigator's error covariance along a straight edge: the recursion of the bound
(`isogal.evaluation.bound`) with the reading interval as its step.

Thirteen errors of the navigator, the map's error along the track, and offset and drift of the
readings. Auxiliary states of the filter are left out here; the route that is found is assessed
with them."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature
from isogal.earth.gravity import normal_gravity
from isogal.evaluation.ins_error_model import initial_covariance, noise_density
from isogal.evaluation.planning.lattice import Lattice
from isogal.evaluation.reading_errors import effective_noise_variance
from isogal.fields.measured import measured_field
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.inertial.rotations import from_heading, matrix
from isogal.maps.error_model import markov_step
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matrices import product, product_transposed
from isogal.scenario import Scenario
from isogal.sensors.reduction import State

SIZE = STATES + 3
"""Navigator's errors, map error, offset and drift."""


class Edges(NamedTuple):
    """What the kernel needs besides the place, by direction (D)."""

    velocity: Array
    """(D, 2) m/s north and east."""
    rotation: Array
    """(D, 3, 3) body to NED."""
    jacobian: Array
    """(D, 4) a reading's derivative by the navigator's error."""
    white: Array
    """(D, SIZE, SIZE) density of the white noise that enters the navigator's errors."""
    map_error: Array
    """(2,) variance and correlation length of the map's error where the map says nothing."""
    constants: Array
    """(4,) reading interval s, noise variance, height m, gravity m/s²."""


def edges_of(scenario: Scenario, lattice: Lattice, quantisation: float) -> Edges:
    """Return the edges of a lattice, driven with a scenario's speed and sensors."""
    world = scenario.informed
    speed, height = world.route.speed, world.route.height
    middle = len(lattice.latitude) // 2, lattice.middle
    latitude, longitude = float(lattice.latitude[middle]), float(lattice.longitude[middle])
    velocity = speed * np.stack([np.cos(lattice.heading), np.sin(lattice.heading)], axis=1)
    here = np.full(len(velocity), latitude), np.full(len(velocity), longitude)
    at = State(*here, np.full(len(velocity), height), velocity[:, 0], velocity[:, 1])
    rotation, density = matrix(from_heading(lattice.heading)), noise_density(world)
    white = np.zeros((len(rotation), SIZE, SIZE))
    white[:, 2:4, 2:4] = (rotation * density[:3] @ rotation.transpose(0, 2, 1))[:, :2, :2]
    white[:, 4:7, 4:7] = rotation * density[3:] @ rotation.transpose(0, 2, 1)
    return Edges(
        velocity,
        rotation,
        np.ascontiguousarray(measured_field(scenario).reduction(scenario).jacobian(at)),
        white,
        np.array([world.map_error.sigma**2, world.map_error.correlation_length]),
        np.array(
            [
                world.gravimeter.interval,
                effective_noise_variance(world.gravimeter, quantisation),
                height,
                float(normal_gravity(latitude, height)),
            ]
        ),
    )


def start_covariance(scenario: Scenario, own_variance: float) -> Array:
    """Return the covariance (SIZE, SIZE) at the start, with the variance of the map's error."""
    world = scenario.informed
    P = np.zeros((SIZE, SIZE))
    P[:STATES, :STATES] = initial_covariance(world)
    P[STATES, STATES] = own_variance
    P[-2, -2] = world.gravimeter.bias**2 + world.map_error.offset**2
    P[-1, -1] = world.gravimeter.drift**2
    return P


@kernel(error_model="numpy")
def _update(P: Array, h: Array, noise: float, column: Array) -> None:
    """Take a reading with a derivative h (n,) and a variance into a covariance (n, n), in place;
    `column` (n,) is work space."""
    n, total = P.shape[0], noise
    for i in range(n):
        column[i] = 0.0
        for j in range(n):
            column[i] += P[i, j] * h[j]
        total += column[i] * h[i]
    for i in range(n):
        for j in range(n):
            P[i, j] -= column[i] * column[j] / total


@kernel(error_model="numpy")
def along_edge(
    P: Array,
    latitude: float,
    longitude: float,
    length: float,
    direction: int,
    edges: Edges,
    grid: Grid,
    sigma: Array,
) -> Array:
    """Return the covariance at the end of an edge.

    Parameters
    ----------
    P : (SIZE, SIZE) array
        At its beginning.
    latitude, longitude : float
        rad, where it begins.
    length : float
        m.
    direction : int
        Of the lattice, counted as in `edges`.
    edges : Edges
    grid : Grid
        The map.
    sigma : (n, m) array
        1-sigma of its error.
    """
    velocity, rotation, jacobian, white, map_error, constants = edges
    vn, ve = velocity[direction]
    interval, noise, height, gravity = constants
    speed = math.sqrt(vn * vn + ve * ve)
    count = max(1, int(length / (speed * interval) + 0.5))
    dt = length / (speed * count)
    n = P.shape[0]
    m = n - 3
    force = np.array([0.0, 0.0, -gravity])
    meridian, normal = curvature(math.sin(latitude))
    inv_m, inv_n = 1.0 / (meridian + height), 1.0 / (normal + height)
    geometry = np.array([latitude, vn, ve, inv_m, inv_n])
    F = np.zeros((n, n))
    fill_dynamics(F, geometry, force, rotation[direction])
    F[n - 2, n - 1] = 1.0
    transition = product(F, F)
    for i in range(n):
        for j in range(n):
            transition[i, j] = (i == j) + dt * F[i, j] + 0.5 * dt * dt * transition[i, j]
    c, joins = markov_step(speed * dt, map_error[1])
    transition[m, m] = c
    half, before = np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            half[i, j] = 0.5 * dt * white[direction, i, j]
    h, column = np.zeros(n), np.empty(n)
    for k in range(count):
        lat = latitude + (k + 1) * dt * vn * inv_m
        lon = longitude + (k + 1) * dt * ve * inv_n / math.cos(lat)
        _, by_lat, by_lon = value_and_gradient(grid, lat, lon)
        i = int((lat - grid.latitude0) / grid.latitude_step + 0.5)
        j = int((lon - grid.longitude0) / grid.longitude_step + 0.5)
        known = not math.isnan(by_lat)
        variance = sigma[i, j] ** 2 if known else P[m, m]
        half[m, m] = variance * joins / (1.0 + c * c)
        for i in range(n):
            for j in range(n):
                before[i, j] = P[i, j] + half[i, j]
        P = product_transposed(product(transition, before), transition)
        for i in range(n):
            for j in range(n):
                P[i, j] += half[i, j]
        if known:
            for i in range(4):
                h[i] = jacobian[direction, i]
            h[0] -= by_lat * inv_m
            h[1] -= by_lon * inv_n / math.cos(lat)
            h[m] = h[n - 2] = 1.0
            _update(P, h, noise, column)
    return P
