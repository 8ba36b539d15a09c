"""The exact likelihood of a batch given the navigator's error, with a correlated map error.

With xi the navigator's error at the batch end, the residual of scan t is

    r_t(xi) = reading_t - offset_t - reading_jacobian_t xi - map(p_t - transition_t xi)

(of a filtered reading a weighted mean of the map over the path behind p_t)
and r = e - G d with

    e ~ N(0, R)   R = diag(sigma_t² + q²/12) + sigma_map² exp(-|x_i - x_j| / L) + sigma_bias²:
                  white noise of the sensor and of the map's rounding to steps of q, map error with
                  an exponential covariance, an unknown constant;
    d ~ N(0, 1)   nuisance parameters: what tilt, heading and the sensor's bias add within the
                  batch, through the map's gradient and the reduction.

Where a map says how wrong it is from place to place, R is taken with the mean of sigma_map² over
where the readings may have been taken: the same R for every candidate. With an R of its own for
each, the determinants would decide between candidates, and they know the map error far less well
than an exponential covariance of dense readings pretends.

Rows that an earlier batch has used come first (context). By the chain rule the new rows count
given the old: with R = L L' and w = L⁻¹ r, the last components of w are the innovations of the new
readings once the map error seen in the old ones is known, and D = (L⁻¹ G)_new is what the nuisance
parameters do to them; the navigator's prior of d already knows the old readings. So
log p = -½ |C⁻¹ w|², C C' = 1 + D D', and no reading counts twice.

docs/mathematics.md, section 5.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.compiled import kernel
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.likelihood_kernels import (
    Readings,
    last_rows,
    linearise,
    log_likelihood,
    nuisance,
    reducing,
    rows_of,
)
from isogal.matching.pmht.noise_model import (
    NoiseModel,
    batch_covariance,
)
from isogal.matrices import inverted, product


@dataclass(frozen=True, slots=True, eq=False)
class BatchLikelihood:
    """A batch and a map as arrays for the kernels. T rows that have a reading."""

    grid: Grid
    readings: Readings
    nuisance_position: Array
    """(T, 2, M)."""
    nuisance_reading: Array
    """(T, M)."""
    covariance: Array
    """(T, T) R: covariance of sensor, map and bias."""
    whitening: Array
    """(T, n) transpose of the last n rows of L⁻¹, which make the n new readings' whitened
    residuals of residuals."""
    reduction: Array
    """(T, n) the same with the nuisance parameters integrated out: W C'⁻¹ of the whitening W."""
    first_new: int
    """Row of the first reading that no earlier batch has used."""
    rows: Integers
    """(T,) index of each row in the batch."""

    @classmethod
    def of(
        cls,
        batch: Batch,
        field_map: FieldMap | ChannelMap,
        noise: NoiseModel,
        place: tuple[Array, Array] | None = None,
    ) -> "BatchLikelihood":
        """Prepare a batch; scans without a reading are left out.

        Parameters
        ----------
        place : ((4,), (4, 4)) arrays, optional
            Mean and covariance of xi over which a map error that differs from place to place is
            averaged; default: the batch's prior.
        """
        rows = np.flatnonzero(np.isfinite(batch.reading))
        channel = (
            np.zeros(len(rows), dtype=np.int64) if batch.channel is None else batch.channel[rows]
        )
        covariance = batch_covariance(
            batch, rows, channel, field_map, noise, place or (np.zeros(4), batch.prior)
        )
        readings = Readings.of(batch, rows, channel)
        position, reading = (
            rows_of(array, rows) for array in (batch.nuisance_position, batch.nuisance_reading)
        )
        first_new = int(np.searchsorted(rows, len(batch) - batch.new))
        whitening = last_rows(np.linalg.cholesky(covariance), first_new)
        effect = nuisance(field_map.grid, readings, position, reading, np.zeros(4))
        return cls(
            grid=field_map.grid,
            readings=readings,
            nuisance_position=position,
            nuisance_reading=reading,
            covariance=covariance,
            whitening=whitening,
            reduction=reducing(whitening, effect),
            first_new=first_new,
            rows=rows,
        )

    def log(self, xi: Array) -> Array:
        """Return (S,) log-likelihood (without its constant) of the new readings at errors xi (S,
        4); -inf off the map.
        """
        return log_likelihood(
            self.grid,
            self.readings,
            self.reduction,
            np.ascontiguousarray(xi),
        )

    def linearise(self, xi: Array) -> tuple[Array, Array]:
        """Return residuals (T,) and their derivative by xi (T, 4) at one error xi (4,)."""
        return linearise(self.grid, self.readings, xi)

    def reduced(self, xi: Array) -> tuple[Array, Array]:
        """Return the new readings' residuals (n,), whitened and without what the nuisance
        parameters explain, and their derivative by xi (n, 4); log-likelihood = -|residuals|² / 2.
        """
        residual, slope = self.linearise(xi)
        if not np.isfinite(residual).all():
            return residual, slope
        return self.reduction.T @ residual, self.reduction.T @ slope

    def whitened(self, of_rows: Array) -> Array:
        """Return (n, ...) the new readings' part of what is known of all rows (T, ...), given that
        of the older ones and in units of its 1-sigma."""
        return np.asarray(self.whitening.T @ of_rows)

    def nuisance_at(self, xi: Array) -> Array:
        """Return G (T, M), what each nuisance parameter takes off the residuals at the error xi
        (4,); zero where the map has no gradient.
        """
        return nuisance(
            self.grid, self.readings, self.nuisance_position, self.nuisance_reading, xi
        )

    def with_nuisance_at(self, xi: Array) -> "BatchLikelihood":
        """Return the likelihood with G taken at the error xi (4,)."""
        return replace(self, reduction=reducing(self.whitening, self.nuisance_at(xi)))

    def with_nuisance_of(self, batch: Batch) -> "BatchLikelihood":
        """Return the likelihood with the nuisance parameters of another batch of these scans."""
        likelihood = replace(
            self,
            nuisance_position=rows_of(batch.nuisance_position, self.rows),
            nuisance_reading=rows_of(batch.nuisance_reading, self.rows),
        )
        return likelihood.with_nuisance_at(np.zeros(4))

    def nuisance_given(self, xi: Array) -> tuple[Array, Array, Array]:
        """Return mean (M,), derivative by xi (M, 4) and covariance (M, M) of the nuisance
        parameters d given the new readings and an error near xi (4,).

        The whitened new residuals are w = e - D d, with e and d ~ N(0, 1).
        """
        residual, slope = self.linearise(xi)
        by, covariance = _explained(self.whitening, residual, slope, self.nuisance_at(xi))
        return by[:, 0], by[:, 1:], covariance

    def scaled(self, variance: float) -> "BatchLikelihood":
        """Return the likelihood with R times a factor."""
        likelihood = replace(
            self,
            covariance=self.covariance * variance,
            whitening=self.whitening / math.sqrt(variance),
        )
        return likelihood.with_nuisance_at(np.zeros(4))

    def without(self, bad: Booleans) -> "BatchLikelihood":
        """Return the likelihood without some of its rows (T,)."""
        if not bad.any():
            return self
        good = ~bad
        likelihood = replace(
            self,
            readings=self.readings.part(good),
            nuisance_position=rows_of(self.nuisance_position, good),
            nuisance_reading=rows_of(self.nuisance_reading, good),
            rows=self.rows[good],
            first_new=int(good[: self.first_new].sum()),
        )
        return likelihood._with_covariance(self.covariance[np.ix_(good, good)])

    def _with_covariance(self, covariance: Array) -> "BatchLikelihood":
        whitening = last_rows(np.linalg.cholesky(covariance), self.first_new)
        likelihood = replace(self, covariance=covariance, whitening=whitening)
        return likelihood.with_nuisance_at(np.zeros(4))

    def blurred(self, sigma: float, velocity: Array) -> "BatchLikelihood":
        """Return the likelihood for a position known to a cell only and a velocity error that is
        integrated out.

        Parameters
        ----------
        sigma : float
            1-sigma of another white noise on every row, for what the map changes within the cell.
        velocity : (2, 2) array
            Covariance of the velocity error, m²/s²; it enters by the reduction of the readings.
        """
        reduction = self.readings.jacobian[:, 2:]
        covariance = (
            self.covariance
            + sigma**2 * np.eye(len(self.rows))
            + reduction @ velocity @ reduction.T
        )
        return self._with_covariance(covariance)

    def misfit(self, xi: Array) -> float:
        """Return the chi-square of the new readings at xi (4,): -2 `log`."""
        return -2.0 * float(self.log(xi[None])[0])

    @property
    def new_count(self) -> int:
        """How many new readings there are."""
        return len(self.rows) - self.first_new

    @property
    def log_normaliser(self) -> float:
        """Log of the constant that `log` leaves out, for comparing noise models."""
        white = float(np.log(np.diag(self.reduction[self.first_new :])).sum())
        return white - 0.5 * math.log(2.0 * math.pi) * self.new_count


@kernel
def _explained(whitening, residual, slope, effect):  # type: ignore[no-untyped-def]
    """Return means and derivatives (M, 5) of nuisance parameters with effects (T, M), and their
    covariance (M, M), given the readings' residuals (T,) and derivatives (T, 4)."""
    rows, new = whitening.shape
    count = effect.shape[1]
    white = np.zeros((new, 5 + count))
    for t in range(rows):
        for k in range(max(t - rows + new, 0), new):
            weight = whitening[t, k]
            white[k, 0] += weight * residual[t]
            for i in range(4):
                white[k, 1 + i] += weight * slope[t, i]
            for m in range(count):
                white[k, 5 + m] += weight * effect[t, m]
    inner, seen = np.eye(count), np.zeros((count, 5))
    for k in range(new):
        for a in range(count):
            for b in range(count):
                inner[a, b] += white[k, 5 + a] * white[k, 5 + b]
            for i in range(5):
                seen[a, i] -= white[k, 5 + a] * white[k, i]
    covariance = inverted(inner)
    return product(covariance, seen), covariance
