"""What each model of the map's error believes of that error and of the readings' bias, from
reading to reading.

Along a track, a map error whose correlation is exp(-d / L) is a Gauss-Markov process. So for each
sigma and L a Kalman filter of three states, the map's error at the last reading, the bias and its
drift, holds all that past readings say under that model, and the density of new readings given all
past ones is that of its innovations: the evidence by which models are compared
(docs/mathematics.md, section 9.1; Bar-Shalom, Li & Kirubarajan 2001, section 11.6). Each model has
the bias that it would have learnt itself: what one model's bias leaves unknown is no excuse for
another.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.likelihood_kernels import Readings, linearise, nuisance, rows_of

STATES = 3
"""Map error, bias, drift per second."""


@dataclass(frozen=True, slots=True, eq=False)
class NewReadings:
    """The new readings of a batch without what is known of their bias, linearised in the
    navigator's error."""

    time: Array
    """(n,) s."""
    latitude: Array
    """(n,) rad."""
    longitude: Array
    """(n,) rad."""
    residual: Array
    """(n,) reading less the map, where the navigator believes to be."""
    unknown: Array
    """(n, q) what the navigator's error does to it, per unit-variance component."""
    variance: Array
    """(n,) of the white noise."""
    bias_walk: float
    """1-sigma of the bias's random walk, unit per sqrt(s)."""

    @classmethod
    def of(cls, batch: Batch, rows: Integers, field_map: FieldMap, mean: Array) -> "NewReadings":
        """Return the readings of some rows (n,), linearised at the error mean (4,)."""
        readings = Readings.of(batch, rows, np.zeros(len(rows), dtype=np.int64))
        residual, slope = linearise(field_map.grid, readings, mean)
        drifts = rows_of(batch.nuisance_position, rows), rows_of(batch.nuisance_reading, rows)
        drift = nuisance(field_map.grid, readings, *drifts, mean)
        return cls(
            batch.time[rows],
            readings.latitude,
            readings.longitude,
            residual - slope @ mean,
            np.concatenate([slope @ np.linalg.cholesky(batch.prior), drift], axis=1),
            batch.sigma[rows] ** 2 + field_map.quantisation**2 / 12.0,
            batch.bias_walk,
        )


@dataclass(frozen=True, slots=True, eq=False)
class ErrorChain:
    """The filters of all models, S sigmas times L lengths, after a reading."""

    mean: Array
    """(S, L, 3)."""
    covariance: Array
    """(S, L, 3, 3)."""
    time: float
    """s, of the reading."""
    place: tuple[float, float]
    """rad, of the reading."""
    biased: bool
    """Whether a bias is in question."""

    @classmethod
    def before(cls, sigma: Array, length: Array, new: NewReadings) -> "ErrorChain":
        """Return the filters before the first of some readings, of models with sigmas (S,) and
        lengths (L,), without a bias."""
        covariance = np.zeros((len(sigma), len(length), STATES, STATES))
        covariance[..., 0, 0] = sigma[:, None] ** 2
        place = float(new.latitude[0]), float(new.longitude[0])
        return cls(np.zeros(covariance.shape[:3]), covariance, float(new.time[0]), place, False)

    def with_bias(self, sigma: Array) -> "ErrorChain":
        """Return the filters where a bias and drift of unknown size, 1-sigma (2,), come up."""
        covariance = self.covariance.copy()
        covariance[..., 1, 1] += sigma[0] ** 2
        covariance[..., 2, 2] += sigma[1] ** 2
        return replace(self, covariance=covariance, biased=True)

    def after(self, sigma: Array, length: Array, new: NewReadings) -> tuple["ErrorChain", Array]:
        """Return the filters after new readings, and (S, L) the log densities of these given the
        ones before, without the constant."""
        elapsed, travelled = _steps(self.time, *self.place, new.time, new.latitude, new.longitude)
        mean, covariance, evidence = _filtered(
            self.mean,
            self.covariance,
            sigma**2,
            length,
            elapsed,
            travelled,
            new.residual,
            np.ascontiguousarray(new.unknown),
            new.variance,
            new.bias_walk**2,
        )
        end = float(new.latitude[-1]), float(new.longitude[-1])
        return ErrorChain(mean, covariance, float(new.time[-1]), end, self.biased), evidence


def is_chain(batch: Batch) -> bool:
    """Whether the errors of a batch's readings are those of one map along a track, with white
    noise and a bias."""
    if batch.filter_path is not None or batch.parameters is not None or batch.delay_sigma > 0.0:
        return False
    covariance = batch.reading_covariance
    white = covariance is None or not (covariance - np.diag(np.diag(covariance))).any()
    return white and batch.rows_per_scan == 1


@kernel
def _steps(  # type: ignore[no-untyped-def]
    time, latitude, longitude, times, latitudes, longitudes
):
    """Return (n,) the seconds and metres from each place (rad) to the next, from a first one on
    to n others."""
    elapsed, travelled = np.empty(times.shape[0]), np.empty(times.shape[0])
    for t in range(times.shape[0]):
        north, east = curvature(math.sin(latitude))
        d_lon = longitudes[t] - longitude
        d_lon -= 2.0 * math.pi * math.floor(d_lon / (2.0 * math.pi) + 0.5)
        east *= math.cos(latitude)
        travelled[t] = math.hypot((latitudes[t] - latitude) * north, d_lon * east)
        elapsed[t] = times[t] - time
        time, latitude, longitude = times[t], latitudes[t], longitudes[t]
    return elapsed, travelled


@kernel
def _filtered(  # type: ignore[no-untyped-def]
    mean, covariance, variances, lengths, elapsed, travelled, residual, unknown, noise, walk
):
    """Return means (S, L, 3), covariances (S, L, 3, 3) and log densities (S, L) after residuals
    (n,), each `elapsed` s and `travelled` m (n,) after the one before.

    The navigator's error, unit-variance components (q,) that are the same for all residuals and
    known by none before, joins the states for as long as that. All models go side by side.
    """
    n, q = unknown.shape
    size, models, count = 3 + q, mean.shape[0] * mean.shape[1], lengths.shape[0]
    x, P = np.zeros((size, models)), np.zeros((size, size, models))  # of P the lower triangle
    PH, kept, spread = np.empty((size, models)), np.empty(models), np.empty(models)
    innovation, evidence = np.empty(models), np.zeros(models)
    for m in range(models):
        for a in range(3):
            x[a, m] = mean[m // count, m % count, a]
            for b in range(a + 1):
                P[a, b, m] = covariance[m // count, m % count, a, b]
        for a in range(3, size):
            P[a, a, m] = 1.0
    for t in range(n):
        _carry(x, P, np.exp(-travelled[t] / lengths), variances, elapsed[t], walk, kept)
        for a in range(size):
            row, first, second = PH[a], P[a, 0], P[max(a, 1), min(a, 1)]
            for m in range(models):
                row[m] = first[m] + second[m]
            for b in range(3, size):
                weight, other = unknown[t, b - 3], P[max(a, b), min(a, b)]
                for m in range(models):
                    row[m] += weight * other[m]
        for m in range(models):
            spread[m] = noise[t] + PH[0, m] + PH[1, m]
            innovation[m] = residual[t] - x[0, m] - x[1, m]
        for a in range(3, size):
            weight = unknown[t, a - 3]
            for m in range(models):
                spread[m] += weight * PH[a, m]
                innovation[m] -= weight * x[a, m]
        for m in range(models):
            kept[m] = 1.0 / spread[m]
            evidence[m] -= 0.5 * (math.log(spread[m]) + innovation[m] ** 2 * kept[m])
        for a in range(size):
            for m in range(models):
                x[a, m] += PH[a, m] * kept[m] * innovation[m]
            for b in range(a + 1):
                row, left, right = P[a, b], PH[a], PH[b]
                for m in range(models):
                    row[m] -= left[m] * kept[m] * right[m]
    out_mean, out = np.empty_like(mean), np.empty_like(covariance)
    for m in range(models):
        for a in range(3):
            out_mean[m // count, m % count, a] = x[a, m]
            for b in range(3):
                out[m // count, m % count, a, b] = P[max(a, b), min(a, b), m]
    return out_mean, out, evidence.reshape(mean.shape[:2])


@kernel
def _carry(x, P, by_length, variances, step, walk, kept):  # type: ignore[no-untyped-def]
    """Carry states (n, S L) and the lower triangles of their covariances (n, n, S L) to the next
    reading, `step` s later, in place; of the map's error `by_length` (L,) is kept. Write what of
    it each model keeps (S L,)."""
    size, models = x.shape
    count = by_length.shape[0]
    for m in range(models):
        c = by_length[m % count]
        kept[m] = c
        x[0, m] *= c
        x[1, m] += step * x[2, m]
        P[0, 0, m] = c * c * P[0, 0, m] + variances[m // count] * (1.0 - c * c)
        P[1, 0, m] = c * (P[1, 0, m] + step * P[2, 0, m])
        P[1, 1, m] += step * (2.0 * P[2, 1, m] + step * P[2, 2, m] + walk)
        P[2, 0, m] *= c
        P[2, 1, m] += step * P[2, 2, m]
    for a in range(3, size):
        for m in range(models):
            P[a, 0, m] *= kept[m]
            P[a, 1, m] += step * P[a, 2, m]
