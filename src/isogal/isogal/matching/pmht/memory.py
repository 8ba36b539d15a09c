"""What `pmht` carries from batch to batch, and how a hypothesis about the navigator's error
ages."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.map_error import NoiseEstimate
from isogal.matching.pmht.sensor_bias import BiasEstimate


@dataclass(frozen=True, slots=True)
class Scale:
    """Variance of unit weight over the last batches, held at 1 by a prior until the residuals
    clearly say more."""

    misfit: float = 60.0
    freedom: float = 60.0

    @property
    def factor(self) -> float:
        """Variance to multiply R by, >= 1."""
        ratio = self.misfit / self.freedom
        return ratio if ratio > 1.0 + 4.0 * math.sqrt(2.0 / self.freedom) else 1.0

    def seen(self, misfit: float, freedom: float) -> "Scale":
        """Add the chi-square of a batch, forgetting over some ten batches."""
        return Scale(0.9 * self.misfit + misfit, 0.9 * self.freedom + freedom)


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What one run's matcher knows from its earlier batches."""

    time: float
    prior: Array
    """(4, 4) the navigator's covariance at that time, after the fix if one was published."""
    belief: Mixture | None
    """Hypotheses about the navigator's error at that time; None = the navigator's own prior is all
    there is."""
    suspicion: int = 0
    """Inconsistent batches in a row."""
    excluded: frozenset[float] = frozenset()
    """Stamps of readings left out."""
    noise: NoiseEstimate | None = None
    """Running estimate of the map's error, where it is not given."""
    bias: BiasEstimate | None = None
    """The readings' bias, where it is not known to be nothing."""
    scale: Scale = Scale()
    """Running estimate of how much larger the residuals' variance is than assumed."""
    evidence: float = 0.0
    """Log probability density of all readings so far, each batch given the ones before."""


def prior_of(batch: Batch, memory: Memory | None) -> Mixture:
    """Return the belief about xi before the batch: carried hypotheses moved to the batch end, or
    the navigator's own prior."""
    if memory is None or memory.belief is None:
        return Mixture.gaussian(np.zeros(4), batch.prior)
    gain, rest = _carry(batch, float(batch.time[-1]) - memory.time)
    return memory.belief.moved(gain, rest)


def _carry(batch: Batch, elapsed: float) -> tuple[Array, Array]:
    """Return gain (4, 4) and covariance (4, 4): xi given the error x where the last batch ended is
    N(gain x, covariance).

    By the navigator's own joint prior of both, x = A xi + D e with e ~ N(0, 1): whatever it knows
    about how its errors go together, over priors of tens of km as well, a hypothesis about x
    knows, too."""
    back, drift = (array[:4] for array in batch.back(elapsed))
    then = back @ batch.prior @ back.T + drift @ drift.T
    gain = np.asarray(np.linalg.solve(then, back @ batch.prior).T, dtype=np.float64)
    values, vectors = np.linalg.eigh(_symmetric(batch.prior - gain @ then @ gain.T))
    rest = (vectors * np.maximum(values, 0.0)) @ vectors.T + 1e-12 * np.diag(np.diag(batch.prior))
    return gain, rest


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + matrix.T)
