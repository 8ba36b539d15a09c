"""How wrong a map is, by tracks whose positions are known (docs/mathematics.md, section 10.4).

Along a track with known positions the residuals, readings less the map's values, are r ~ N(0, R)
with R_ij = sensor² d_ij + sigma_i sigma_j exp(-|x_i - x_j| / L). The parameters of R that make the
residuals of reference tracks most likely (Rasmussen & Williams 2006, Gaussian Processes for
Machine Learning, section 5.4) are then used for other tracks. A map drawn from scattered
measurements is most wrong where the field varies most between them. So, unless the map says its
1-sigma place by place, it is taken as sqrt(floor² + (reach g)²) with g the RMS gradient round the
place, as if the values were displaced by `reach`."""

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
    least = math.log(_least_length(residuals, field_map))
    spread = math.sqrt(float(np.mean(np.concatenate([one.value for one in residuals]) ** 2)))
    if not isinstance(field_map.sigma, float):
        own = [np.asarray(field_map.sigma_at(one.latitude, one.longitude)) for one in residuals]
        start = np.log([2000.0, 0.2 * spread])
        x, value = _maximise(
            lambda p: _log_likelihood(residuals, own, max(p[0], least), p[1]), start
        )
        found = MapError(math.exp(max(x[0], least)), math.exp(x[1]), log_likelihood=value)
        return _completed(found, residuals, own, bool(x[0] <= least))
    best: tuple[MapError, list[Array], bool] | None = None
    for smoothing in SMOOTHING:
        shape = replace(field_map, sigma=rms_gradient(field_map, smoothing))
        rough = [np.asarray(shape.sigma_at(one.latitude, one.longitude)) for one in residuals]
        typical = math.sqrt(float(np.nanmean(np.concatenate(rough) ** 2)))
        start = np.log([2000.0, 0.1 * spread, 0.3 * spread, spread / typical])

        def log_likelihood_of(p: Array, rough: list[Array] = rough) -> float:
            sigma = [np.hypot(math.exp(p[2]), math.exp(p[3]) * one) for one in rough]
            return _log_likelihood(residuals, sigma, max(p[0], least), p[1])

        x, value = _maximise(log_likelihood_of, start)
        if best is None or value > best[0].log_likelihood:
            length, sensor, floor, reach = (math.exp(p) for p in (max(x[0], least), *x[1:]))
            sigma = [np.hypot(floor, reach * one) for one in rough]
            found = MapError(length, sensor, floor, reach, smoothing, value)
            best = found, sigma, bool(x[0] <= least)
    assert best is not None  # SMOOTHING is not empty
    return _completed(best[0], residuals, *best[1:])


def _least_length(residuals: "list[_Residuals]", field_map: FieldMap) -> float:
    """Return the shortest correlation length (m) that readings and map can show: the spacing of
    the readings, or of the nodes where that is larger."""
    steps = np.concatenate([np.diag(one.distance, 1) for one in residuals])
    nodes = field_map.cell_size_m(float(np.mean(field_map.latitude)))
    return max(float(np.median(steps)), math.sqrt(math.prod(nodes)))


def _completed(
    found: MapError, residuals: "list[_Residuals]", sigma: list[Array], at_bound: bool
) -> MapError:
    """Return an error with the datum's offset and the typical sigma."""
    length, sensor = math.log(found.correlation_length), math.log(found.sensor_sigma)
    sums = np.array(
        [_level(one, own, length, sensor) for one, own in zip(residuals, sigma, strict=True)]
    ).sum(axis=0)
    return replace(
        found,
        typical_sigma=math.sqrt(float(np.nanmean(np.concatenate(sigma) ** 2))),
        offset=float(sums[1] / sums[0]),
        offset_sigma=float(1.0 / math.sqrt(sums[0])),
        at_bound=at_bound,
    )


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


def _whitened(
    one: "_Residuals", own: Array, log_length: float, log_sensor: float
) -> tuple[Array, Array, float]:
    """Return L⁻¹ r, L⁻¹ 1 and half the log determinant of R = L L'."""
    from scipy.linalg import cholesky, solve_triangular

    covariance = np.exp(-one.distance / math.exp(log_length))
    covariance *= own[:, None]
    covariance *= own
    # a millionth of the variance keeps R regular where two readings have the same place
    covariance[np.diag_indices(own.size)] += math.exp(2.0 * log_sensor) + 1e-6 * own**2
    factor = cholesky(covariance, lower=True, overwrite_a=True, check_finite=False)
    both = np.column_stack([one.value, np.ones(own.size)])
    white = solve_triangular(factor, both, lower=True, check_finite=False)
    return white[:, 0], white[:, 1], float(np.log(np.diag(factor)).sum())


def _level(
    one: "_Residuals", own: Array, log_length: float, log_sensor: float
) -> tuple[float, float]:
    """Return 1' R⁻¹ 1 and 1' R⁻¹ r."""
    value, ones, _ = _whitened(one, own, log_length, log_sensor)
    return float(ones @ ones), float(ones @ value)


def _log_likelihood(
    residuals: list[_Residuals], sigma: list[Array], log_length: float, log_sensor: float
) -> float:
    """Return the log-likelihood with the offset that makes it largest: one datum for all."""
    total, own_sum, product = 0.0, 0.0, 0.0
    for one, own in zip(residuals, sigma, strict=True):
        value, ones, half = _whitened(one, own, log_length, log_sensor)
        total -= 0.5 * float(value @ value) + half
        own_sum += float(ones @ ones)
        product += float(ones @ value)
    return total + 0.5 * product**2 / own_sum


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
