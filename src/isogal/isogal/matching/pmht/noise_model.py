"""What is assumed about residuals, and their covariance: white noise, map error correlated along
the track, an unknown constant.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature, metres_per_radian
from isogal.maps.channels import ChannelMap, by_channel, channels_of
from isogal.maps.error_ellipses import joint
from isogal.maps.field_map import FieldMap
from isogal.maps.tensor_error import displacements, shares, tensor_covariance
from isogal.matching.interfaces import Batch
from isogal.matching.path import FilterPath
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.quasi_random import standard_normal
from isogal.matrices import symmetric


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """What is assumed about everything that is not the sensor's own noise. Map's unit, m."""

    map_sigma: float = 0.0
    correlation_length: float = 4000.0
    bias_sigma: float = 0.0


def batch_covariance(
    batch: Batch,
    rows: Integers,
    channel: Integers,
    field_map: FieldMap | ChannelMap,
    noise: NoiseModel,
    place: tuple[Array, Array],
) -> Array:
    """Return R of the likelihood's equation for rows (T,) of a batch.

    Parameters
    ----------
    channel : (T,) array
        Index of each row's map.
    place : ((4,), (4, 4)) arrays
        Mean and covariance of xi over which a map error that differs from place to place is
        averaged.
    """
    latitude, longitude = batch.latitude[rows], batch.longitude[rows]
    maps, tensor = channels_of(field_map), batch.of_one_potential
    own_sigma = map_sigmas(field_map, channel, latitude, longitude, batch.transition[rows], *place)
    rounding = np.array([one.quantisation**2 / 12.0 for one in maps])[channel]
    sensor = batch.sigma[rows] ** 2
    map_sigma = np.maximum(noise.map_sigma, own_sigma)
    lengths = correlation_lengths(field_map, channel, noise, latitude, longitude)
    covariance = residual_covariance(
        latitude,
        longitude,
        sensor + rounding,
        map_sigma if tensor is None else np.zeros(len(rows)),
        lengths,
        noise.bias_sigma,
        channel if len(maps) > 1 else None,
        None if batch.filter_path is None else batch.filter_path.part(rows),
    )
    if tensor is not None and map_sigma.any():
        of_dd = tensor_sigmas(tensor, channel, noise.map_sigma, own_sigma)
        apart = displacements(latitude, longitude)
        shape = tensor_covariance(tensor, channel, apart, float(np.mean(lengths)))
        if (of_dd > noise.map_sigma).any():
            alone = np.exp(-np.hypot(apart[..., 0], apart[..., 1]) / np.mean(lengths))
            alone *= shares(tensor)[channel] * (channel[:, None] == channel)
            shape = CONSTANTS.of_one_potential * shape + (1.0 - CONSTANTS.of_one_potential) * alone
        covariance += of_dd[:, None] * of_dd * shape
    if batch.reading_covariance is not None:
        covariance += batch.reading_covariance[np.ix_(rows, rows)] - np.diag(sensor)
    return covariance


def residual_covariance(
    latitude: Array,
    longitude: Array,
    white_variance: Array,
    map_sigma: Array,
    correlation_length: float | Array,
    bias_sigma: float,
    channel: Integers | None = None,
    filter_path: FilterPath | None = None,
) -> Array:
    """Return R (T, T) of the likelihood's equation (`isogal.matching.pmht.likelihood`); positions
    rad, the rest in the map's unit and m.

    Map errors and biases of different channels (T,) are independent (but see
    `batch_covariance`); a correlation length (T, 1)
    is the same for all rows of a channel, one that differs from place to place is (T,), one that
    also differs from direction to direction (T, 3) (`isogal.maps.error_ellipses`). Map errors of
    readings that are a mean over a path are means over it as well.
    """
    if channel is None and filter_path is None and isinstance(correlation_length, float):
        sigma = np.ascontiguousarray(map_sigma)
        return np.asarray(
            _of_one_map(latitude, longitude, white_variance, sigma, correlation_length, bias_sigma)
        )
    covariance = np.diag(white_variance)
    together = 1.0 if channel is None else (channel[:, None] == channel).astype(np.float64)
    if np.any(map_sigma > 0.0):
        if np.shape(correlation_length)[1:] == (3,):
            apart = displacements(latitude, longitude)
            shape = _directed_correlation(apart, np.asarray(correlation_length), filter_path)
        else:
            apart = distances(latitude, longitude)
            shape = map_correlation(apart, correlation_length, filter_path)
        covariance = covariance + map_sigma[:, None] * map_sigma * shape * together
    return covariance + bias_sigma**2 * together


def tensor_sigmas(components: Sequence[str], channel: Integers, told: float, own: Array) -> Array:
    """Return (T,) the 1-sigma of T_dd's error where a sigma of it is told and the map says (T,)
    how wrong each channel is itself: the larger one."""
    return np.maximum(told, own / np.sqrt(shares(components))[channel])


@kernel
def _of_one_map(latitude, longitude, white, sigma, length, bias):  # type: ignore[no-untyped-def]
    """Return `residual_covariance` of readings that are compared with one map, which is wrong over
    one length."""
    out = np.zeros((latitude.shape[0], latitude.shape[0]))
    if sigma.any():
        out = distances(latitude, longitude)
        for i in range(out.shape[0]):
            for j in range(i + 1):
                shape = math.exp(-out[i, j] / length)
                out[i, j] = out[j, i] = sigma[i] * sigma[j] * shape
    for i in range(out.shape[0]):
        out[i, i] += white[i]
        for j in range(out.shape[0]):
            out[i, j] += bias * bias
    return out


@kernel
def distances(latitude, longitude):  # type: ignore[no-untyped-def]
    """Return (T, T) m between places (T,) in rad: means of what they are with the radii at the
    one and at the other."""
    count = latitude.shape[0]
    north, east = np.empty(count), np.empty(count)
    for i in range(count):
        north[i], east[i] = curvature(math.sin(latitude[i]))
        east[i] *= math.cos(latitude[i])
    out = np.zeros((count, count))
    for i in range(count):
        for j in range(i):
            d_lat, d_lon = latitude[i] - latitude[j], longitude[i] - longitude[j]
            d_lon -= 2.0 * math.pi * math.floor(d_lon / (2.0 * math.pi) + 0.5)
            total = 0.0
            for k in (i, j):
                total += math.sqrt((d_lat * north[k]) ** 2 + (d_lon * east[k]) ** 2)
            out[i, j] = out[j, i] = 0.5 * total
    return out


def map_correlation(
    distance: Array, length: float | Array, filter_path: FilterPath | None = None
) -> Array:
    """Return (T, T) the correlation of map errors of readings at distances (m) from each other;
    lengths and path as in `residual_covariance`."""
    if filter_path is not None:
        return _mean_over(filter_path, distance, length)
    return _correlation(distance, length)


def _correlation(distance: Array, length: float | Array) -> Array:
    """Return (N, N) the correlation of map errors at distances (m): exp(-d / L).

    Where L differs from row to row, (N,), it is with l² = (L_i² + L_j²) / 2 between rows i and j
    L_i L_j / l² exp(-d / l), which is positive definite (Paciorek & Schervish 2006, Environmetrics
    17(5), theorem 1, for the exponential in the plane).
    """
    if isinstance(length, np.ndarray) and length.ndim == 1:
        square = 0.5 * (length[:, None] ** 2 + length**2)
        return np.asarray(np.outer(length, length) / square * np.exp(-distance / np.sqrt(square)))
    return np.asarray(np.exp(-distance / length))


def _directed_correlation(apart: Array, ellipses: Array, path: FilterPath | None) -> Array:
    """Return (T, T) the correlation of map errors at places (T, T, 2) m apart whose lengths differ
    from direction to direction, (T, 3); after a filter as if all lengths were as the usual one."""
    relative, alike = joint(apart, ellipses)
    usual = float(np.mean((ellipses[:, 0] * ellipses[:, 2] - ellipses[:, 1] ** 2) ** 0.25))
    return alike * map_correlation(usual * relative, usual, path)


def _mean_over(path: FilterPath, distance: Array, length: float | Array) -> Array:
    """Return (T, T) the correlation of the map's error after the instrument's filter, at distances
    (m) between rows: of a Gauss-Markov process after a first-order low-pass filter, whose memory
    is s = speed times time constant,

        L (L exp(-d / L) - s exp(-d / s)) / (L² - s²) .

    Positive definite in the plane, as the spectrum of l exp(-d / l) grows with l. A length that
    differs from place to place counts with its mean.
    """
    mean, memory = float(np.sqrt(np.mean(np.square(length)))), max(path.memory, 1e-3)
    if abs(mean - memory) < 1e-3 * mean:
        memory = 0.999 * mean
    both = mean * np.exp(-distance / mean) - memory * np.exp(-distance / memory)
    return np.asarray(mean * both / (mean**2 - memory**2))


def correlation_lengths(
    field_map: FieldMap | ChannelMap,
    channel: Integers,
    noise: NoiseModel,
    latitude: Array,
    longitude: Array,
) -> float | Array:
    """Return what is assumed. Where the map says of its error that it is larger than that, and
    over which length it holds together: (T,) that length at places (rad), (T, 3) that in each
    direction (`isogal.maps.error_ellipses`), or (T, 1) that of each channel.
    """
    if isinstance(field_map, FieldMap):
        directed, lengths = field_map.error_ellipses, field_map.correlation_lengths
        if (directed is None and lengths is None) or not (
            np.nanmean(field_map.sigma) > noise.map_sigma
        ):
            return noise.correlation_length
        if directed is not None:
            ellipses = field_map.error_ellipse_at(latitude, longitude)
            usual = noise.correlation_length**2 * np.array([1.0, 0.0, 1.0])
            return np.where(np.isfinite(ellipses), ellipses, usual)
        there = np.asarray(field_map.correlation_length_at(latitude, longitude))
        return np.where(np.isfinite(there), there, noise.correlation_length)
    length = [
        one.correlation_length
        if one.correlation_length and np.nanmean(one.sigma) > noise.map_sigma
        else noise.correlation_length
        for one in field_map.channels
    ]
    return np.array(length)[channel][:, None]


def uneven(field_map: FieldMap | ChannelMap) -> bool:
    """Whether a map says that it is more wrong in some places than in others."""
    return any(not isinstance(one.sigma, float) for one in channels_of(field_map))


def map_sigmas(
    field_map: FieldMap | ChannelMap,
    channel: Integers,
    latitude: Array,
    longitude: Array,
    transition: Array,
    mean: Array,
    covariance: Array,
) -> Array:
    """Return (T,) the root mean square of the map's own sigma over where each row may have been
    taken; 0 where it has none.
    """
    if isinstance(field_map, FieldMap) and isinstance(field_map.sigma, float):
        return np.full(len(latitude), field_map.sigma)
    if not uneven(field_map):
        return np.nan_to_num(by_channel(field_map, channel, "sigma_at", latitude, longitude))
    values, vectors = np.linalg.eigh(symmetric(covariance))
    xi = mean + standard_normal(64, 4) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    north, east = metres_per_radian(latitude)
    moved = np.einsum("tij,sj->sti", transition, xi)
    there = by_channel(
        field_map,
        np.tile(channel, len(xi)),
        "sigma_at",
        (latitude - moved[..., 0] / north).reshape(-1),
        (longitude - moved[..., 1] / east).reshape(-1),
    ).reshape(len(xi), -1)
    known = np.isfinite(there)
    return np.sqrt((np.nan_to_num(there) ** 2).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
