"""Map error estimated from the residuals, for maps that do not say how wrong they are.

The marginal likelihood of each batch's residuals, linearised at the estimated position with the navigator's error integrated out, is
added up over batches on a grid of (sigma, correlation length): a discrete posterior under a log-uniform prior (type-II likelihood,
Rasmussen & Williams 2006, section 5.4).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.likelihood import BatchLikelihood, NoiseModel, residual_covariance

Array = NDArray[np.float64]

_SHARES = np.geomspace(0.002, 0.5, 13)
"""Grid of sigma, as shares of the map's own standard deviation."""
_LENGTHS = np.geomspace(500.0, 16000.0, 6)
"""Grid of the correlation length, m."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseEstimate:
    """Discrete posterior of the map error's sigma and correlation length."""

    sigma: Array
    """(S,) grid, map's unit."""
    log_evidence: Array
    """(S, L) summed over batches."""
    batches: int = 0

    @classmethod
    def start(cls, batch: Batch, field_map: FieldMap) -> "NoiseEstimate":
        """Return the prior: every sigma and length equally likely."""
        near = field_map.values[
            :: max(1, field_map.values.shape[0] // 200), :: max(1, field_map.values.shape[1] // 200)
        ]
        scale = max(float(np.nanstd(near)), float(np.nanmedian(batch.sigma)))
        return cls(scale * _SHARES, np.zeros((len(_SHARES), len(_LENGTHS))))

    @property
    def probability(self) -> Array:
        """(S, L) posterior."""
        p = np.exp(self.log_evidence - self.log_evidence.max())
        return p / p.sum()

    def model(self, base: NoiseModel) -> NoiseModel:
        """Return the noise model with the posterior's mean variance and mean log length."""
        p = self.probability
        return replace(
            base,
            map_sigma=float(np.sqrt((p.sum(axis=1) * self.sigma**2).sum())),
            correlation_length=float(np.exp((p.sum(axis=0) * np.log(_LENGTHS)).sum())),
        )

    def differs(self, other: "NoiseEstimate", factor: float = 1.2) -> bool:
        """Whether two estimates differ by more than a factor in sigma or length."""
        a, b = self.model(NoiseModel()), other.model(NoiseModel())
        ratios = np.log([a.map_sigma / b.map_sigma, a.correlation_length / b.correlation_length])
        return bool(np.abs(ratios).max() > np.log(factor))

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
        known = slope[new] @ batch.prior @ slope[new].T + drift @ drift.T
        white = batch.sigma[rows] ** 2 + field_map.quantisation**2 / 12.0
        evidence = np.empty_like(self.log_evidence)
        ones = np.ones(len(rows))
        for j, length in enumerate(_LENGTHS):
            shape = residual_covariance(batch.latitude[rows], batch.longitude[rows], 0.0 * white, ones, length, 0.0)
            for i, sigma in enumerate(self.sigma):
                factor = np.linalg.cholesky(known + sigma**2 * shape + np.diag(white) + bias_sigma**2)
                evidence[i, j] = -0.5 * (np.linalg.solve(factor, apart) ** 2).sum() - np.log(np.diag(factor)).sum()
        return replace(self, log_evidence=self.log_evidence + evidence, batches=self.batches + 1)

    def figures(self) -> dict[str, float]:
        """Return the estimate for the diagnostics."""
        model = self.model(NoiseModel())
        return {"map_sigma": model.map_sigma, "map_correlation_length_m": model.correlation_length}
