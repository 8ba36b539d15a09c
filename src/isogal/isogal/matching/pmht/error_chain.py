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
    known by none before, joins the states for as long as that.
    """
    n, q = unknown.shape
    size = 3 + q
    out_mean, out_covariance = np.empty_like(mean), np.empty_like(covariance)
    evidence = np.empty(mean.shape[:2])
    x, P = np.empty(size), np.empty((size, size))
    H, PH = np.empty(size), np.empty(size)
    for i in range(variances.shape[0]):
        for j in range(lengths.shape[0]):
            P[:] = 0.0
            x[:] = 0.0
            for a in range(3):
                x[a] = mean[i, j, a]
                for b in range(3):
                    P[a, b] = covariance[i, j, a, b]
            for a in range(3, size):
                P[a, a] = 1.0
            total = 0.0
            for t in range(n):
                kept = math.exp(-travelled[t] / lengths[j])
                x[0] *= kept
                x[1] += elapsed[t] * x[2]
                for b in range(size):
                    P[0, b] *= kept
                    P[1, b] += elapsed[t] * P[2, b]
                for b in range(size):
                    P[b, 0] *= kept
                    P[b, 1] += elapsed[t] * P[b, 2]
                P[0, 0] += variances[i] * (1.0 - kept * kept)
                P[1, 1] += walk * elapsed[t]
                H[0], H[1], H[2] = 1.0, 1.0, 0.0
                for a in range(q):
                    H[3 + a] = unknown[t, a]
                spread, innovation = noise[t], residual[t]
                for a in range(size):  # P is symmetric: its rows are its columns
                    PH[a] = 0.0
                for b in range(size):
                    for a in range(size):
                        PH[a] += P[b, a] * H[b]
                for a in range(size):
                    spread += H[a] * PH[a]
                    innovation -= H[a] * x[a]
                inverse = 1.0 / spread
                for a in range(size):
                    gain = PH[a] * inverse
                    x[a] += gain * innovation
                    for b in range(size):
                        P[a, b] -= gain * PH[b]
                total += 0.5 * (math.log(spread) + innovation * innovation / spread)
            evidence[i, j] = -total
            for a in range(3):
                out_mean[i, j, a] = x[a]
                for b in range(3):
                    out_covariance[i, j, a, b] = P[a, b]
    return out_mean, out_covariance, evidence
