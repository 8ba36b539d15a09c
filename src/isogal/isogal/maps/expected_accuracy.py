"""How good can a fix be here? The Fisher information that readings along a track hold about where
the track lies.

Linearised about the true place and for a rigid shift of a stretch of track: with J (T, 2) the
map's gradient at T readings and R_ij = sigma² d_ij + s_i s_j exp(-d_ij / L) + b² (white sensor
noise and rounding, map error, unknown offset), the information is J' R^-1 J and its inverse the
Cramér-Rao bound of the shift (Van Trees 2001, Detection, Estimation, and Modulation Theory I, sec.
2.4.2; docs/mathematics.md, sections 5.2 and 11.2). By how much a gridded map may show anomalies
beside their place (`isogal.maps.displacement`) is added to it, unless `Errors` says what the map's
error is. It knows nothing of ambiguity: a first fix from far away can be worse."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.gravity import normal_gravity_gradient_north
from isogal.errors import InputError
from isogal.maps.corridor import along_track
from isogal.maps.displacement import displacement_at
from isogal.maps.error_model import covariance
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import ScalarMap


@dataclass(frozen=True)
class Errors:
    """What is wrong with readings and map, in the map's unit."""

    sensor_sigma: float
    """1-sigma white noise of a reading, > 0."""
    map_sigma: float | None = None
    """1-sigma of the map's error; None = as the map says."""
    correlation_length: float = 4000.0
    """Of that error, m."""
    bias_sigma: float = 0.0
    """1-sigma of an unknown constant offset of the readings."""
    least_map_sigma: float = 0.0
    """1-sigma of the map's error where the map says less."""

    def covariance(self, field_map: ScalarMap, latitude: Array, longitude: Array) -> Array:
        """Return R (K, K) of readings at some places (rad)."""
        if self.map_sigma is None:
            said = field_map.sigma_at(latitude, longitude)
            said = np.nan_to_num(said, nan=float(np.nanmedian(field_map.sigma)))
            map_sigma = np.maximum(said, self.least_map_sigma)
        else:
            map_sigma = np.full(latitude.size, self.map_sigma)
        white = self.sensor_sigma**2 + field_map.quantisation**2 / 12.0
        of_map = covariance(latitude, longitude, map_sigma, self.correlation_length)
        return white * np.eye(latitude.size) + self.bias_sigma**2 + of_map


@dataclass(frozen=True)
class Stretches:
    """Expected fixes from stretches of a track, S of them, each from its own readings alone."""

    start: Array
    """(S,) m along the track."""
    end: Array
    """(S,) m."""
    latitude: Array
    """(S,) rad, middle reading."""
    longitude: Array
    """(S,) rad."""
    readings: Integers
    """(S,)"""
    gradient: Array
    """(S,) RMS of the gradient's size, unit per m."""
    covariance: Array
    """(S, 2, 2) m², north-east; infinite where the readings leave a direction open, NaN where the
    map has no values."""

    @property
    def axes(self) -> tuple[Array, Array]:
        """1-sigma along the best and the worst direction, m, (S,) each."""
        known = np.isfinite(self.covariance).all(axis=(1, 2))
        values = np.full((self.start.size, 2), math.inf)
        values[known] = np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariance[known]), 0.0))
        values[np.isnan(self.covariance).any(axis=(1, 2))] = math.nan
        return values[:, 0], values[:, 1]


def position_information(
    field_map: ScalarMap,
    latitude: Array,
    longitude: Array,
    errors: Errors,
    stretch: float = 5000.0,
) -> Stretches:
    """Return what readings at points of a track tell about its position, stretch by stretch.

    Parameters
    ----------
    field_map : FieldMap or TiledMap
        The map. A gravity disturbance is measured as gravity less normal gravity where the
        navigator believes to be, so that the change of normal gravity to the north counts as
        signal.
    latitude, longitude : (K,) rad
        Where the readings are taken.
    errors : Errors
        Noise, map error and offset.
    stretch : float
        m; 0 = one stretch.

    Raises
    ------
    InputError
        Fewer than two points.
    """
    if latitude.size < 2:
        raise InputError(f"position information needs at least two readings, has {latitude.size}")
    distance = along_track(latitude, longitude)
    edges = _edges(float(distance[-1]), stretch)
    owner = np.searchsorted(edges, distance, side="right") - 1
    slope = _slopes(field_map, latitude, longitude)
    found = np.full((edges.size, 2, 2), np.nan)
    gradient = np.full(edges.size, np.nan)
    middle, count = np.zeros((2, edges.size), dtype=np.int64)
    for index in range(edges.size):
        here = np.flatnonzero(owner == index)
        count[index] = here.size
        if not here.size:
            continue
        middle[index] = here[here.size // 2]
        gradient[index] = math.sqrt(np.mean(np.sum(slope[here] ** 2, axis=1)))
        noise = errors.covariance(field_map, latitude[here], longitude[here])
        if np.isfinite(slope[here]).all() and np.isfinite(noise).all():
            found[index] = _inverse(slope[here].T @ np.linalg.solve(noise, slope[here]))
            if errors.map_sigma is None and isinstance(field_map, FieldMap):
                beside = displacement_at(field_map, latitude[here], longitude[here])
                found[index] += np.mean(beside**2) * np.eye(2)
    return Stretches(
        edges,
        np.r_[edges[1:], distance[-1]],
        latitude[middle],
        longitude[middle],
        count,
        gradient,
        found,
    )


def _slopes(field_map: ScalarMap, latitude: Array, longitude: Array) -> Array:
    """Return (K, 2) by how much readings change per m to the north and to the east."""
    _, north, east = field_map.value_and_gradient(latitude, longitude)
    if field_map.quantity.endswith("disturbance"):
        north = north + normal_gravity_gradient_north(latitude)
    return np.stack([north, east], axis=1)


def _edges(total: float, stretch: float) -> Array:
    """Return where the stretches of a track of this length begin, m."""
    edges = np.arange(0.0, total, stretch) if stretch > 0.0 else np.zeros(1)
    # a short rest joins the last stretch
    return edges[:-1] if edges.size > 1 and total - edges[-1] < 0.5 * stretch else edges


def _inverse(information: Array) -> Array:
    """Invert a 2 x 2 information matrix; all infinite where it leaves a direction open."""
    if np.linalg.cond(information) > 1e12 or not information.any():
        return np.full((2, 2), math.inf)
    return np.linalg.inv(information).astype(np.float64)
