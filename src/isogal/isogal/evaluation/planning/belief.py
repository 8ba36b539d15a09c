"""The navigator's error covariance along straight edges: the linear model of the bound
(`isogal.evaluation.ins_error_model`) with the reading interval as its step.

Thirteen errors of the navigator, the map's error along the track, and offset and drift of the
readings. Auxiliary states of the filter are left out here; the route that is found is assessed
with them."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import radii
from isogal.earth.gravity import normal_gravity
from isogal.evaluation.ins_error_model import (
    Segments,
    initial_covariance,
    transitions,
)
from isogal.evaluation.planning.lattice import Lattice
from isogal.evaluation.reading_errors import effective_noise_variance
from isogal.fields.measured import measured_field
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.inertial.error_model import STATES
from isogal.inertial.rotations import from_heading, matrix
from isogal.maps.field_map import FieldMap
from isogal.scenario import Truth
from isogal.sensors.reduction import State

_MAP, _OFFSET, _DRIFT = range(STATES, STATES + 3)
"""States beside the navigator's errors."""


class Edges:
    """The edges of a lattice, driven over a map with the speed and sensors of a truth."""

    def __init__(self, truth: Truth, lattice: Lattice, field_map: FieldMap) -> None:
        self._truth, self._map, self._length = truth, field_map, lattice.length
        self._velocity = truth.route.speed * np.stack(
            [np.cos(lattice.heading), np.sin(lattice.heading)], axis=1
        )
        self._rotation = matrix(from_heading(lattice.heading))
        self._noise = effective_noise_variance(truth.gravimeter, field_map.quantisation)
        middle = len(lattice.latitude) // 2, lattice.middle
        place = lattice.latitude[middle], lattice.longitude[middle], truth.route.height
        at = State(*np.broadcast_arrays(*place, *self._velocity.T))
        self._jacobian = measured_field(truth).reduction(truth).jacobian(at)
        sensor, error = truth.gravimeter, truth.map_error
        self._states = [
            AuxiliaryState("map", "none", 0, 1.0, length=error.correlation_length),
            AuxiliaryState("offset", "none", 0, math.hypot(sensor.bias, error.offset)),
            AuxiliaryState("drift", "none", 0, sensor.drift),
        ]

    def _map_variance(self, latitude: Array, longitude: Array) -> Array:
        """Return the variance of the map's error at places: what the map says, or `map_error`
        where that is larger."""
        said = np.nan_to_num(self._map.sigma_at(latitude, longitude))
        return np.square(np.maximum(said, self._truth.map_error.sigma))

    def start(self, latitude: float, longitude: float) -> Array:
        """Return the covariance (n, n) at the start, a place in rad."""
        truth = self._truth
        P = initial_covariance(truth.initial_error, truth.imu.sensors, self._states)
        P[_MAP, _MAP] = self._map_variance(np.array(latitude), np.array(longitude))
        return P

    def along(
        self, P: Array, latitude: Array, longitude: Array, elapsed: Array, direction: int
    ) -> Array:
        """Return the covariances (W, n, n) at the ends of edges.

        Parameters
        ----------
        P : (W, n, n) array
            At their beginnings.
        latitude, longitude : (W,) arrays
            rad, where they begin.
        elapsed : (W,) array
            s since the start, there.
        direction : int
            Of the lattice.
        """
        (north, east), length = self._velocity[direction], self._length[direction]
        interval, route = self._truth.gravimeter.interval, self._truth.route
        count = max(1, round(length / (route.speed * interval)))
        dt, ones = length / (route.speed * count), np.ones(len(P))
        meridian, normal = (one + route.height for one in radii(latitude))
        gravity = normal_gravity(latitude, route.height)
        segments = Segments(
            np.stack([latitude, north * ones, east * ones, 1 / meridian, 1 / normal], axis=1),
            np.stack([0.0 * ones, 0.0 * ones, -gravity], axis=1),
            np.broadcast_to(self._rotation[direction], (len(P), 3, 3)),
            np.zeros((len(P), 3)),
            dt,
            1,
        )
        steps = transitions(segments, self._truth.imu, self._states)
        transition, half = (np.array(each) for each in zip(*steps, strict=True))
        of_map = half[:, _MAP, _MAP].copy()  # of a variance of one
        h = np.zeros(P.shape[:2])
        for k in range(1, count + 1):
            there = latitude + k * dt * north / meridian
            across = longitude + k * dt * east / (normal * np.cos(there))
            _, by_north, by_east = self._map.value_and_gradient(there, across)
            known = np.isfinite(by_north)
            variance = np.where(known, self._map_variance(there, across), P[:, _MAP, _MAP])
            half[:, _MAP, _MAP] = of_map * variance
            P = transition @ (P + half) @ transition.swapaxes(1, 2) + half
            h[:, :4] = self._jacobian[direction]
            h[:, 0] -= by_north
            h[:, 1] -= by_east
            h[:, [_MAP, _OFFSET]], h[:, _DRIFT] = 1.0, elapsed + k * dt
            h[~known] = 0.0  # such a reading tells nothing
            gain = np.einsum("wij,wj->wi", P, h)
            total = self._noise + np.einsum("wi,wi->w", h, gain)
            P -= gain[:, :, None] * gain[:, None, :] / total[:, None, None]
        return P
