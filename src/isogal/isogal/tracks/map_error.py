"""How wrong a map is, by tracks whose positions are known (docs/mathematics.md, section 10.4).

Along a track with known positions the residuals, readings less the map's values, are r ~ N(0, R)
with R_ij = sensor² d_ij + sigma_i sigma_j exp(-|x_i - x_j| / L). The parameters of R that make the
residuals of reference tracks most likely (Rasmussen & Williams 2006, Gaussian Processes for
Machine Learning, section 5.4) are then used for other tracks. A map drawn from scattered
measurements is most wrong where the field varies most between them. So, unless the map says its
1-sigma place by place, it is taken as sqrt(floor² + (reach g)²) with g the RMS gradient round the
place, as if the values were displaced by `reach`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.error_model import decay, displacements
from isogal.maps.field_map import FieldMap
from isogal.tracks.track import Track

SMOOTHING = 2000.0
"""m, 1-sigma of the Gaussian weights with which the gradient is averaged: of 1, 2 and 4 km the
likeliest along the flight lines and along the tie lines over Scotland
(docs/evidence/real-data.md)."""


@dataclass(frozen=True, slots=True)
class MapError:
    """Parameters of a map's error, in the map's unit and m."""

    correlation_length: float
    """m."""
    sensor_sigma: float
    """1-sigma of the white noise of the reference tracks' readings."""
    floor: float = 0.0
    """Least 1-sigma of the map."""
    reach: float = 0.0
    """m, 1-sigma of the map per unit of its RMS gradient; 0 = the map's own sigma is used instead
    of floor and reach."""
    typical_sigma: float = math.nan
    """RMS 1-sigma of the map along the reference tracks."""
    offset: float = 0.0
    """By which the readings lie above the map on the mean: the map's wrong datum."""
    offset_sigma: float = 0.0
    """1-sigma of `offset`."""
    at_bound: bool = False
    """Whether the correlation length would have become shorter than the readings and the map
    can show."""

    def apply(self, field_map: FieldMap) -> FieldMap:
        """Return the map with this error, and on the datum of the readings."""
        field_map = replace(field_map, values=field_map.values + self.offset)
        sigma = field_map.sigma
        if self.reach > 0.0:
            sigma = np.hypot(self.floor, self.reach * rms_gradient(field_map))
        return replace(field_map, sigma=sigma, correlation_length=self.correlation_length)


def rms_gradient(field_map: FieldMap) -> Array:
    """Return (n, m) the RMS gradient (unit/m) round each node, with Gaussian weights of 1-sigma
    `SMOOTHING`."""
    from scipy.ndimage import gaussian_filter

    latitude, longitude = np.meshgrid(field_map.latitude, field_map.longitude, indexing="ij")
    _, north, east = field_map.value_and_gradient(latitude, longitude)
    known = np.isfinite(north)
    cell = field_map.cell_size_m(float(np.mean(field_map.latitude)))
    widths = [SMOOTHING / size for size in cell]
    square = gaussian_filter(np.where(known, north**2 + east**2, 0.0), widths, mode="constant")
    weight = gaussian_filter(known.astype(np.float64), widths, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(np.where(weight > 1e-6, square / weight, np.nan))


def fit_map_error(references: Sequence[Track], field_map: FieldMap) -> MapError:
    """Fit the error of a map to tracks whose positions are true.

    Parameters
    ----------
    references : sequence of Track
        Each is a track of its own: map errors of different tracks count as independent.
    field_map : FieldMap
        If it has a sigma for each node, only correlation length and sensor noise are fitted.

    Raises
    ------
    InputError
        None of the tracks has three readings on the map.
    """
    lines = [_Line.of(track, field_map) for track in references]
    lines = [one for one in lines if one.value.size >= 3]
    if not lines:
        raise InputError("no reference track lies on the map")
    least = math.log(_least_length(lines, field_map))
    spread = math.sqrt(float(np.mean(np.concatenate([one.value for one in lines]) ** 2)))
    shape, start = field_map, [2000.0, 0.2 * spread]
    if isinstance(field_map.sigma, float):
        shape = replace(field_map, sigma=rms_gradient(field_map))
    at_lines = [np.asarray(shape.sigma_at(one.latitude, one.longitude)) for one in lines]
    if shape is not field_map:
        start = [2000.0, 0.1 * spread, 0.3 * spread, spread / _rms(at_lines)]
    return _fit(lines, at_lines, np.log(start), least)


def _fit(lines: "Sequence[_Line]", shape: Sequence[Array], start: Array, least: float) -> MapError:
    """Return the likeliest error by the logs of length (at least `least`), sensor's noise and, if
    `start` has them, floor and reach, by a simplex search (Nelder & Mead 1965, Comput. J.
    7:308-313)."""
    from scipy.optimize import minimize

    def sigma_of(p: Array) -> Sequence[Array]:
        if len(p) == 2:
            return shape
        return [np.hypot(math.exp(p[2]), math.exp(p[3]) * one) for one in shape]

    def cost(p: Array) -> float:
        return -_likelihood(lines, sigma_of(p), max(p[0], least), p[1])[0]

    options = {"xatol": 0.02, "fatol": 0.05, "maxiter": 400}
    x = minimize(cost, start, method="Nelder-Mead", options=options).x
    sigma, length = sigma_of(x), max(x[0], least)
    _, offset, offset_sigma = _likelihood(lines, sigma, length, x[1])
    floor, reach = np.exp(x[2:]).tolist() if len(x) > 2 else (0.0, 0.0)
    return MapError(
        *(math.exp(length), math.exp(x[1]), floor, reach),
        typical_sigma=_rms(sigma),
        offset=offset,
        offset_sigma=offset_sigma,
        at_bound=bool(x[0] <= least),
    )


def _likelihood(
    lines: "Sequence[_Line]", sigma: Sequence[Array], log_length: float, log_sensor: float
) -> tuple[float, float, float]:
    """Return the log-likelihood with the offset that makes it largest, one datum for all lines,
    that offset, and its 1-sigma."""
    from scipy.linalg import cholesky, solve_triangular

    total, known, product = 0.0, 0.0, 0.0
    for one, own in zip(lines, sigma, strict=True):
        R = decay(one.distance, math.exp(log_length)) * own[:, None] * own
        # a millionth of the variance keeps R regular where two readings have the same place
        R[np.diag_indices(own.size)] += math.exp(2.0 * log_sensor) + 1e-6 * own**2
        factor = cholesky(R, lower=True, overwrite_a=True, check_finite=False)
        both = np.column_stack([one.value, np.ones(own.size)])
        value, ones = solve_triangular(factor, both, lower=True, check_finite=False).T
        total -= 0.5 * float(value @ value) + float(np.log(np.diag(factor)).sum())
        known += float(ones @ ones)
        product += float(ones @ value)
    return total + 0.5 * product**2 / known, product / known, 1.0 / math.sqrt(known)


def _rms(each: Sequence[Array]) -> float:
    return math.sqrt(float(np.nanmean(np.concatenate(each) ** 2)))


def _least_length(lines: "Sequence[_Line]", field_map: FieldMap) -> float:
    """Return the shortest correlation length (m) that readings and map can show: the spacing of
    the readings, or of the nodes where that is larger."""
    steps = np.concatenate([np.diag(one.distance, 1) for one in lines])
    nodes = field_map.cell_size_m(float(np.mean(field_map.latitude)))
    return max(float(np.median(steps)), math.sqrt(math.prod(nodes)))


class _Line(NamedTuple):
    """Residuals of one track."""

    latitude: Array
    """(N,) rad."""
    longitude: Array
    """(N,) rad."""
    value: Array
    """(N,) map's unit."""
    distance: Array
    """(N, N) m."""

    @classmethod
    def of(cls, track: Track, field_map: FieldMap) -> "_Line":
        where = track.latitude, track.longitude
        value = track.value - track.offset - field_map.value(*where)
        keep = np.isfinite(value) & np.isfinite(field_map.sigma_at(*where))
        latitude, longitude = (one[keep] for one in where)
        apart = displacements(latitude, longitude)
        return cls(latitude, longitude, value[keep], np.hypot(apart[..., 0], apart[..., 1]))
