"""A batch on its way through `pmht`: its likelihood, the readings that stick out, and whether it
agrees with the map."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.matching.chi_square import survival
from isogal.matching.information import with_attitude
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.hypotheses import Update
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.memory import Memory
from isogal.matching.pmht.noise_model import NoiseModel
from isogal.matching.pmht.outliers import outliers, smooth_misfit
from isogal.matching.pmht.sensor_bias import LinearBias


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """A batch on its way through the matcher."""

    batch: Batch
    field_map: FieldMap | ChannelMap
    prior: Mixture
    every: BatchLikelihood
    """Of all readings."""
    bad: Booleans
    """Rows of it that stick out at the best hypothesis and are left out."""
    result: Update
    bias: LinearBias | None
    """In the batch."""
    memory: Memory | None
    """Before the batch."""

    @property
    def sticking_out(self) -> frozenset[float]:
        """Their stamps."""
        return frozenset(float(t) for t in self.batch.time[self.every.rows[self.bad]])

    def posterior(self) -> tuple[Array, Array, Array]:
        """Return mean (n,), covariance and prior (n, n) of the navigator's error at the best
        hypothesis; see `with_attitude`."""
        belief = self.result.belief
        return with_attitude(
            self.batch, self.result.likelihood, belief.mean[0], belief.covariance[0]
        )

    def consistency(self) -> tuple[float, float, float]:
        """Return (misfit, degrees of freedom, p-value) of the new readings at the best hypothesis.

        The posterior mean has absorbed as many degrees of freedom as it has gained on the prior: n
        - tr(1 - posterior prior⁻¹)."""
        absorbed = float(
            np.trace(
                np.eye(4) - np.linalg.solve(self.batch.prior, self.result.belief.covariance[0])
            )
        )
        freedom = max(self.result.likelihood.new_count - min(max(absorbed, 0.0), 4.0), 1.0)
        return self.result.misfit, freedom, survival(self.result.misfit, freedom)

    def agreement(self) -> tuple[float, float, float]:
        """Return (misfit, degrees of freedom, p-value) of the new readings and the prior together
        at the best hypothesis.

        What a wrong place or a bias does to the readings goes where it can: into the residuals, or
        into a posterior far from the prior."""
        apart = self.result.belief.mean[0] - self.prior.mean
        tension = np.einsum(
            "ki,ki->k", apart, np.linalg.solve(self.prior.covariance, apart[..., None])[..., 0]
        ).min()
        misfit, freedom = (
            self.result.misfit + float(tension),
            float(max(self.result.likelihood.new_count, 1)),
        )
        return misfit, freedom, survival(misfit, freedom)


def evidence(result: Update | None) -> float:
    """Return the log evidence with the likelihood's constant, so that noise models compare; None
    is impossible."""
    return -math.inf if result is None else result.log_evidence + result.likelihood.log_normaliser


def likelihood_of(
    batch: Batch,
    field_map: FieldMap | ChannelMap,
    noise: NoiseModel,
    belief: Mixture,
    scale: float = 1.0,
) -> BatchLikelihood:
    """Return the likelihood of a batch whose place is believed to be there, with R times `scale`
    where that is more than 1."""
    likelihood = BatchLikelihood.of(batch, field_map, noise, belief=belief.moments())
    return likelihood.scaled(scale) if scale > 1.0 else likelihood


def without(batch: Batch, stamps: frozenset[float]) -> Batch:
    """Return the batch with the readings of the given stamps removed."""
    if not stamps:
        return batch
    drop = np.isin(batch.time, list(stamps))
    return replace(batch, reading=np.where(drop, np.nan, batch.reading))


def spikes(likelihood: BatchLikelihood, prior: Mixture, gate: float) -> Booleans:
    """Find spikes before the place is known: what a wrong place does to the residuals is smooth
    along the track."""
    mean, covariance = prior.moments()
    residual, slope = likelihood.linearise(mean)
    if not np.isfinite(residual).all():
        return np.zeros(len(residual), dtype=np.bool_)
    reach = slope @ covariance @ slope.T
    smooth = smooth_misfit(
        likelihood.latitude, likelihood.longitude, math.sqrt(float(np.diag(reach).mean())), 1500.0
    )
    smooth *= likelihood.channel[:, None] == likelihood.channel
    drift = likelihood.nuisance_at(mean)
    return outliers(residual, likelihood.covariance + drift @ drift.T + reach + smooth, gate)


def misfits(likelihood: BatchLikelihood, belief: Mixture, gate: float) -> Booleans:
    """Find readings that stick out at the best hypothesis."""
    mean, covariance = belief.mean[0], belief.covariance[0]
    residual, slope = likelihood.linearise(mean)
    if not np.isfinite(residual).all():
        return np.zeros(len(residual), dtype=np.bool_)
    drift = likelihood.nuisance_at(mean)
    return outliers(
        residual, likelihood.covariance + drift @ drift.T + slope @ covariance @ slope.T, gate
    )
