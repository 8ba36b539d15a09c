"""What `pmht` carries from batch to batch, and how hypotheses are carried to the next one."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.map_error import MapErrorEstimate
from isogal.matching.pmht.sensor_bias import BiasEstimate
from isogal.matching.pmht.taken import has_taken
from isogal.matrices import positive_part, symmetric


@dataclass(frozen=True, slots=True)
class VarianceFactor:
    """Variance of unit weight over the last batches (docs/mathematics.md, section 8.4).

    A prior holds it at 1 until the residuals clearly say more.
    """

    misfit: float = CONSTANTS.variance_factor_freedom
    """Sum of chi-squares."""
    freedom: float = CONSTANTS.variance_factor_freedom
    """Sum of their degrees of freedom."""

    @classmethod
    def known(cls, value: float) -> "VarianceFactor":
        """Return one that is known to have a value."""
        return cls(value * CONSTANTS.variance_factor_freedom)

    @property
    def value(self) -> float:
        """Factor to multiply R by, >= 1."""
        ratio = self.misfit / self.freedom
        chance = CONSTANTS.variance_factor_sigma * math.sqrt(2.0 / self.freedom)
        return ratio if ratio > 1.0 + chance else 1.0

    def updated(self, misfit: float, freedom: float) -> "VarianceFactor":
        """Add the chi-square of a batch; older batches count less and less."""
        kept = CONSTANTS.variance_factor_memory
        return VarianceFactor(kept * self.misfit + misfit, kept * self.freedom + freedom)


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What one run's matcher knows from its earlier batches."""

    time: float
    """s, end of the last batch."""
    prior: Array
    """(4, 4) the navigator's covariance there, before any fix."""
    hypotheses: Mixture | None = None
    """About the navigator's error there; None = its own prior is all there is."""
    current: Mixture | None = None
    """About its error at the end of the next batch, by readings of another field up to there;
    counts before `hypotheses`."""
    taken: Array | None = None
    """(4, 4) covariance there of a navigator that has taken the fix which was published: only of
    such a one the hypotheses are true. None = there was no fix."""
    disagreements: int = 0
    """Batches in a row that did not agree with the map."""
    outlier_times: frozenset[float] = frozenset()
    """Stamps of readings left out."""
    map_error: MapErrorEstimate | None = None
    """Estimate of the map error, where it is not given."""
    bias: BiasEstimate | None = None
    """Of the readings, where it is not known to be nothing."""
    unbiased: bool = False
    """Whether the readings have shown that they have no bias (`BiasEstimate.simplified`)."""
    variance_factor: VarianceFactor = VarianceFactor()
    """How much larger the residuals' variance is than assumed."""
    log_evidence: float = 0.0
    """Log probability density of all readings so far, each batch given the ones before."""

    @classmethod
    def before(cls, batch: Batch) -> "Memory":
        """Return the memory of a matcher whose first batch this is."""
        return cls(float(batch.time[0]), batch.prior)

    def after_others(self, taken: Array, covariance: Array) -> "Memory":
        """See `isogal.matching.several.Sharing`."""
        if self.bias is None:
            return self
        states = self.bias.gain.shape[1]
        error = None if self.bias.error is None else covariance[:states, :states]
        mean = self.bias.mean + self.bias.gain @ taken[:states]
        return replace(self, bias=replace(self.bias, mean=mean, error=error))

    def with_bias(self, bias: BiasEstimate | None) -> "Memory":
        """Return the memory with another belief about the readings' bias."""
        return replace(self, bias=bias)


def prior_of(batch: Batch, memory: Memory | None) -> Mixture:
    """Return the prior of xi: hypotheses carried to the batch end, or the navigator's own."""
    if memory is not None and memory.current is not None:
        return memory.current
    own = Mixture.gaussian(np.zeros(4), batch.prior)
    if memory is None or memory.hypotheses is None:
        return own
    then, gain, rest = _forecast(batch, float(batch.time[-1]) - memory.time)
    if memory.taken is not None and not has_taken(memory.taken, then):
        return own
    return memory.hypotheses.moved(gain, rest)


def _forecast(batch: Batch, elapsed: float) -> tuple[Array, Array, Array]:
    """Return the navigator's covariance (4, 4) where the last batch ended, by its own dynamics,
    and gain (4, 4) and covariance (4, 4): xi given the error x there is N(gain x, covariance).

    By the navigator's own joint prior of both, x = A xi + D e with e ~ N(0, 1): a hypothesis
    about x keeps the correlations of errors that the navigator knows, over tens of km as well.
    """
    back, nuisance = (array[:4] for array in batch.back(elapsed))
    then = back @ batch.prior @ back.T + nuisance @ nuisance.T
    gain = np.asarray(np.linalg.solve(then, back @ batch.prior).T, dtype=np.float64)
    rest = positive_part(symmetric(batch.prior - gain @ then @ gain.T))
    return then, gain, rest + 1e-12 * np.diag(np.diag(batch.prior))
