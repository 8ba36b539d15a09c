"""How wrong a map is, by tracks whose positions are known (docs/mathematics.md, section 10.4).

Along a track with known positions the residuals, readings less the map's values, are r ~ N(0, R)
with the R of `isogal.matching.pmht.likelihood`. The parameters of R that make the residuals of
reference tracks most likely (Rasmussen & Williams 2006, Gaussian Processes for Machine Learning,
section 5.4) are then used for other tracks. A map drawn from scattered measurements is most wrong
where the field varies most between them. So, unless the map says its 1-sigma place by place, it is
taken as sqrt(floor² + (reach g)²) with g the RMS gradient round the place, as if the values were
displaced by `reach`."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.tracks.track import Track

SMOOTHING = (1000.0, 2000.0, 4000.0)
"""m, 1-sigmas of the Gaussian weights with which the gradient is averaged; the likeliest is
taken."""


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
    """m, 1-sigma of the map per unit of its RMS gradient."""
    smoothing: float = 0.0
    """m, over which the gradient is averaged; 0 = the map's own sigma is used instead of floor and
    reach."""
    log_likelihood: float = math.nan

    def apply(self, field_map: FieldMap) -> FieldMap:
        """Return the map with this error."""
        if self.smoothing == 0.0:
            return replace(field_map, correlation_length=self.correlation_length)
        sigma = np.hypot(self.floor, self.reach * rms_gradient(field_map, self.smoothing))
        return replace(field_map, sigma=sigma, correlation_length=self.correlation_length)


def rms_gradient(field_map: FieldMap, smoothing: float) -> Array:
    """Return (n, m) the RMS gradient (unit/m) round each node, with Gaussian weights of 1-sigma
    `smoothing` (m)."""
    from scipy.ndimage import gaussian_filter

    latitude, longitude = np.meshgrid(field_map.latitude, field_map.longitude, indexing="ij")
    _, north, east = field_map.value_and_gradient(latitude, longitude)
    known = np.isfinite(north)
    widths = [
        smoothing / size for size in field_map.cell_size_m(float(np.mean(field_map.latitude)))
    ]
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
    residuals = [_residuals(track, field_map) for track in references]
    residuals = [one for one in residuals if one.value.size >= 3]
    if not residuals:
        raise InputError("no reference track lies on the map")
    spread = math.sqrt(float(np.mean(np.concatenate([one.value for one in residuals]) ** 2)))
    if not isinstance(field_map.sigma, float):
        own = [np.asarray(field_map.sigma_at(one.latitude, one.longitude)) for one in residuals]
        start = np.log([2000.0, 0.2 * spread])
        x, log_likelihood = _maximise(lambda p: _log_likelihood(residuals, own, p[0], p[1]), start)
        return MapError(math.exp(x[0]), math.exp(x[1]), log_likelihood=log_likelihood)
    best: MapError | None = None
    for smoothing in SMOOTHING:
        shape = replace(field_map, sigma=rms_gradient(field_map, smoothing))
        rough = [np.asarray(shape.sigma_at(one.latitude, one.longitude)) for one in residuals]
        typical = math.sqrt(float(np.nanmean(np.concatenate(rough) ** 2)))
        start = np.log([2000.0, 0.1 * spread, 0.3 * spread, spread / typical])

        def log_likelihood_of(p: Array, rough: list[Array] = rough) -> float:
            sigma = [np.hypot(math.exp(p[2]), math.exp(p[3]) * one) for one in rough]
            return _log_likelihood(residuals, sigma, p[0], p[1])

        x, value = _maximise(log_likelihood_of, start)
        if best is None or value > best.log_likelihood:
            length, sensor, floor, reach = (math.exp(p) for p in x)
            best = MapError(length, sensor, floor, reach, smoothing, value)
    assert best is not None  # SMOOTHING is not empty
    return best


@dataclass(frozen=True, slots=True, eq=False)
class _Residuals:
    """Residuals of one track; (N,) each."""

    latitude: Array
    """rad."""
    longitude: Array
    """rad."""
    value: Array
    """Map's unit."""
    distance: Array
    """(N, N) m."""


def _residuals(track: Track, field_map: FieldMap) -> _Residuals:
    value = track.value - track.offset - field_map.value(track.latitude, track.longitude)
    keep = np.isfinite(value) & np.isfinite(field_map.sigma_at(track.latitude, track.longitude))
    latitude, longitude = track.latitude[keep], track.longitude[keep]
    apart = horizontal_difference(latitude[:, None], longitude[:, None], latitude, longitude)
    distance = np.hypot(apart[..., 0], apart[..., 1])
    return _Residuals(latitude, longitude, value[keep], 0.5 * (distance + distance.T))


def _log_likelihood(
    residuals: list[_Residuals], sigma: list[Array], log_length: float, log_sensor: float
) -> float:
    from scipy.linalg import cholesky, solve_triangular

    total = 0.0
    for one, own in zip(residuals, sigma, strict=True):
        covariance = np.exp(-one.distance / math.exp(log_length))
        covariance *= own[:, None]
        covariance *= own
        # a millionth of the variance keeps R regular where two readings have the same place
        covariance[np.diag_indices(own.size)] += math.exp(2.0 * log_sensor) + 1e-6 * own**2
        factor = cholesky(covariance, lower=True, overwrite_a=True, check_finite=False)
        whitened = solve_triangular(factor, one.value, lower=True, check_finite=False)
        total -= 0.5 * float(whitened @ whitened) + float(np.log(np.diag(factor)).sum())
    return total


def _maximise(function: Callable[[Array], float], start: Array) -> tuple[Array, float]:
    """Return where a function is largest and its value there, by a simplex search (Nelder & Mead
    1965, Comput. J. 7:308-313)."""
    from scipy.optimize import minimize

    found = minimize(
        lambda p: -function(p),
        start,
        method="Nelder-Mead",
        options={"xatol": 0.02, "fatol": 0.05, "maxiter": 400},
    )
    return found.x, -float(found.fun)
