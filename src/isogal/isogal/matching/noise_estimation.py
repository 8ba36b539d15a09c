"""Map error estimated from the residuals.

The marginal likelihood of each batch's residuals, linearised at the estimated position with the navigator's error integrated out, is
added up over batches on a grid of (sigma, correlation length): a discrete posterior (type-II likelihood, Rasmussen & Williams 2006,
section 5.4). The prior is log-uniform where nobody says how wrong the map is, and log-normal about what was said where somebody does.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from isogal.kernels import kernel
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.likelihood import BatchLikelihood, NoiseModel, residual_covariance

Array = NDArray[np.float64]

_SHARES = np.geomspace(0.002, 0.5, 13)
"""Grid of an unknown sigma, as shares of the map's own standard deviation."""
_LENGTHS = np.geomspace(500.0, 16000.0, 6)
"""Grid of an unknown correlation length, m."""
_SIGMA_STEPS, _LENGTH_STEPS = np.linspace(-2.0, 2.0, 9), np.linspace(-2.0, 2.0, 5)
"""Grids about what was said, in 1-sigma of the prior of log sigma and log length."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseEstimate:
    """Discrete posterior of the map error's sigma and correlation length."""

    sigma: Array
    """(S,) grid, map's unit."""
    length: Array
    """(L,) grid, m."""
    log_weight: Array
    """(S, L) log of the prior plus the evidence of the batches, without a constant."""
    batches: int = 0

    @classmethod
    def unknown(cls, batch: Batch, field_map: FieldMap) -> "NoiseEstimate":
        """Return the prior of somebody who knows nothing: every sigma and length equally likely."""
        near = field_map.values[
            :: max(1, field_map.values.shape[0] // 200), :: max(1, field_map.values.shape[1] // 200)
        ]
        scale = max(float(np.nanstd(near)), float(np.nanmedian(batch.sigma)))
        return cls(scale * _SHARES, _LENGTHS, np.zeros((len(_SHARES), len(_LENGTHS))))

    @classmethod
    def told(cls, noise: NoiseModel, factor: float) -> "NoiseEstimate":
        """Return the prior of somebody who was told sigma and length, right within a factor (1-sigma)."""
        return cls(
            noise.map_sigma * factor**_SIGMA_STEPS,
            noise.correlation_length * factor**_LENGTH_STEPS,
            -0.5 * (_SIGMA_STEPS[:, None] ** 2 + _LENGTH_STEPS**2),
        )

    @property
    def probability(self) -> Array:
        """(S, L) posterior."""
        p = np.exp(self.log_weight - self.log_weight.max())
        return p / p.sum()

    def model(self, base: NoiseModel) -> NoiseModel:
        """Return the noise model with the posterior's mean variance and mean log length.

        Before the first batch it is the base itself where that says anything.
        """
        if self.batches == 0 and base.map_sigma > 0.0:
            return base
        p = self.probability
        return replace(
            base,
            map_sigma=float(np.sqrt((p.sum(axis=1) * self.sigma**2).sum())),
            correlation_length=float(np.exp((p.sum(axis=0) * np.log(self.length)).sum())),
        )

    def update(
        self, batch: Batch, likelihood: BatchLikelihood, field_map: FieldMap, mean: Array, bias_sigma: float
    ) -> "NoiseEstimate":
        """Add the evidence of the new readings of a batch, linearised at the error mean (4,)."""
        residual, slope = likelihood.linearise(mean)
        if not np.isfinite(residual).all():
            return self
        new = slice(likelihood.first_new, None)
        rows = likelihood.rows[new]
        apart = residual[new] - slope[new] @ mean
        drift = likelihood.drift_at(mean)[new]
        white = batch.sigma[rows] ** 2 + field_map.quantisation**2 / 12.0
        known = slope[new] @ batch.prior @ slope[new].T + drift @ drift.T + np.diag(white) + bias_sigma**2
        ones = np.ones(len(rows))
        shapes = np.stack(
            [
                residual_covariance(batch.latitude[rows], batch.longitude[rows], 0.0 * white, ones, length, 0.0)
                for length in self.length
            ]
        )
        evidence = _evidence(np.ascontiguousarray(known), shapes, self.sigma**2, apart)
        return replace(self, log_weight=self.log_weight + evidence, batches=self.batches + 1)

    def figures(self, base: NoiseModel) -> dict[str, float]:
        """Return the estimate for the diagnostics."""
        model = self.model(base)
        return {"map_sigma": model.map_sigma, "map_correlation_length_m": model.correlation_length}


def differs(a: NoiseModel, b: NoiseModel, factor: float = 1.2) -> bool:
    """Whether two noise models differ by more than a factor in the map error's sigma or length."""
    ratios = a.map_sigma / b.map_sigma, a.correlation_length / b.correlation_length
    return any(abs(math.log(ratio)) > math.log(factor) for ratio in ratios)


@kernel
def _evidence(known, shapes, variances, residual):  # type: ignore[no-untyped-def]
    """Return (S, L) log densities of the residual (n,) under N(0, known + variance shape), without the constant, by Cholesky factors."""
    n = residual.shape[0]
    out = np.empty((variances.shape[0], shapes.shape[0]))
    factor = np.empty((n, n))
    whitened = np.empty(n)
    for i in range(variances.shape[0]):
        for j in range(shapes.shape[0]):
            total = 0.0
            for a in range(n):
                for b in range(a):
                    value = known[a, b] + variances[i] * shapes[j, a, b]
                    for c in range(b):
                        value -= factor[a, c] * factor[b, c]
                    factor[a, b] = value / factor[b, b]
                pivot = known[a, a] + variances[i] * shapes[j, a, a]
                r = residual[a]
                for c in range(a):
                    pivot -= factor[a, c] * factor[a, c]
                    r -= factor[a, c] * whitened[c]
                factor[a, a] = math.sqrt(pivot)
                whitened[a] = r / factor[a, a]
                total += 0.5 * whitened[a] * whitened[a] + math.log(factor[a, a])
            out[i, j] = -total
    return out
