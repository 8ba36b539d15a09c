"""Map error learnt from the residuals.

The marginal likelihood of each batch's new residuals given the ones before, linearised at the
estimated position with the navigator's error integrated out, is added up over batches on a grid of
(sigma, correlation length): a discrete posterior (type-II likelihood, Rasmussen & Williams 2006,
section 5.4). The prior is log-uniform where nothing is told about the map, and log-normal about
what is told otherwise (docs/mathematics.md, section 9.1).
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.tensor_error import displacements, tensor_covariance
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.error_chain import ErrorChain, NewReadings
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.noise_model import NoiseModel, distances, map_correlation

USUAL_LENGTH_M = 4000.0
"""Correlation length of map errors where nobody says otherwise."""
_LENGTHS = np.geomspace(*CONSTANTS.unknown_lengths_m)
_SIGMA_STEPS, _LENGTH_STEPS = (np.linspace(-2.0, 2.0, steps) for steps in CONSTANTS.told_steps)
"""Grids about what was told, in 1-sigma of the prior of log sigma and log length."""


@dataclass(frozen=True, slots=True, eq=False)
class MapErrorPrior:
    """What was believed of the map's error before any reading."""

    sigma: Array
    """(S,) grid, map's unit."""
    length: Array
    """(L,) grid, m."""
    log_weight: Array
    """(S, L) log probability."""

    def or_rather(self, sigma: float, probability: float) -> "MapErrorPrior":
        """Return the prior by which a sigma is right with a probability; else it is this one."""
        of_length = np.logaddexp.reduce(self.log_weight, axis=0)
        return MapErrorPrior(
            np.append(self.sigma, sigma),
            self.length,
            np.vstack(
                [self.log_weight + math.log1p(-probability), of_length + math.log(probability)]
            ),
        )


@dataclass(frozen=True, eq=False)
class MapErrorEstimate:
    """Discrete posterior of the map error's sigma and correlation length; what follows from it is
    computed once, when it is first asked for."""

    sigma: Array
    """(S,) grid, map's unit."""
    length: Array
    """(L,) grid, m."""
    log_weight: Array
    """(S, L) log of the prior plus the evidence of the batches, without a constant."""
    prior: Array
    """(S, L) log of the prior, without a constant."""
    doubtful: float
    """Sigma from which the navigator's place is in doubt rather than the map."""
    batches: int = 0
    chain: ErrorChain | None = None
    """What each of them believes of the map's error at the last reading and of the readings' bias;
    None = there has been no reading."""

    @classmethod
    def unknown(
        cls, batch: Batch, field_map: AnyMap, usual_length: float = USUAL_LENGTH_M
    ) -> "MapErrorEstimate":
        """Return the prior where no sigma is told: every one as likely as any other up to the
        map's roughness, larger ones less so; log-normal about the usual length.
        """
        maps = channels_of(field_map)
        scale = float(np.mean([one.scale for one in maps]))
        rounding = float(np.mean([one.quantisation for one in maps])) / math.sqrt(12.0)
        rough = float(np.mean([roughness(one) for one in maps]))
        least = CONSTANTS.least_sigma_noise_share * math.hypot(
            float(np.nanmedian(batch.sigma)), rounding
        )
        if 0.0 < rough < least:  # readings of much noise make no map worse
            least = rough
        steps = math.log(max(CONSTANTS.largest_sigma_share * scale / least, 4.0))
        count = 1 + math.ceil(steps / math.log(CONSTANTS.sigma_grid_factor))
        sigma: Array = least * np.power(CONSTANTS.sigma_grid_factor, np.arange(float(count)))
        rough = min(max(rough, least), sigma[-1])
        above = np.maximum(np.log(sigma / rough), 0.0) / math.log(CONSTANTS.unknown_sigma_factor)
        factor = CONSTANTS.unknown_length_factor
        apart = np.log(_LENGTHS / usual_length) / math.log(factor)
        prior = -0.5 * (above[:, None] ** 2 + apart**2)
        return cls(sigma, _LENGTHS, prior, prior, CONSTANTS.doubtful_sigma_share * scale)

    @classmethod
    def told(cls, noise: NoiseModel, factor: float) -> "MapErrorEstimate":
        """Return the prior where sigma and length are told, right within a factor
        (1-sigma).
        """
        prior = -0.5 * (_SIGMA_STEPS[:, None] ** 2 + _LENGTH_STEPS**2)
        return cls(
            noise.map_sigma * factor**_SIGMA_STEPS,
            noise.correlation_length * factor**_LENGTH_STEPS,
            prior,
            prior,
            noise.map_sigma,
        )

    @property
    def coarse_prior(self) -> MapErrorPrior:
        """The prior on a part of the grids' points."""
        of_sigma, of_length = (slice(None, None, step) for step in CONSTANTS.coarse_steps)
        log_weight = self.prior[of_sigma, of_length]
        log_weight = log_weight - np.logaddexp.reduce(log_weight, axis=None)
        return MapErrorPrior(self.sigma[of_sigma], self.length[of_length], log_weight)

    @cached_property
    def doubt(self) -> float:
        """Log Bayes factor of a sigma above the one from which there is doubt against one that is
        not.
        """
        return _doubt(self)

    @property
    def probability(self) -> Array:
        """(S, L) posterior."""
        p = np.exp(self.log_weight - self.log_weight.max())
        return p / p.sum()

    def model(self, base: NoiseModel) -> NoiseModel:
        """Return the noise model with the posterior's mean sigma and mean log length.

        Before the first batch it is the base itself where that says anything.
        """
        if self.batches == 0 and base.map_sigma > 0.0:
            return base
        sigma, length = self._model
        return NoiseModel(sigma, length, base.bias_sigma)

    @cached_property
    def _model(self) -> tuple[float, float]:
        """Sigma and length of `model`."""
        sigma, length = _means(self.sigma, self.length, self.log_weight)
        return float(sigma), float(length)

    def follow(self, new: NewReadings, bias_sigma: Array | None) -> "MapErrorEstimate":
        """Add the evidence of new readings given all before, which are a chain
        (`error_chain.is_chain`).

        Parameters
        ----------
        new : NewReadings
        bias_sigma : (2,) array, optional
            1-sigma of the bias and of its drift before any reading; None = there is none.
        """
        if not np.isfinite(new.residual).all() or not len(new.residual):
            return self
        chain = self.chain or ErrorChain.before(self.sigma, self.length, new)
        if bias_sigma is not None and not chain.biased:
            chain = chain.with_bias(bias_sigma)
        chain, evidence = chain.after(self.sigma, self.length, new)
        log_weight, batches = self.log_weight + evidence, self.batches + 1
        return replace(self, log_weight=log_weight, batches=batches, chain=chain)

    def update(
        self, batch: Batch, likelihood: BatchLikelihood, field_map: AnyMap, mean: Array
    ) -> "MapErrorEstimate":
        """Add the evidence of the new readings of a batch given the older ones in it, linearised
        at the error mean (4,).

        The navigator's prior knows the older readings already.
        """
        residual, slope = likelihood.linearise(mean)
        if not np.isfinite(residual).all():
            return self
        maps = channels_of(field_map)
        first = max(likelihood.first_new - CONSTANTS.conditioning_readings * len(maps), 0)
        rows = likelihood.rows[first:]
        slope = slope[first:]
        channel = likelihood.readings.channel[first:]
        rounding = np.array([one.quantisation**2 / 12.0 for one in maps])[channel]
        noise = np.diag(batch.sigma[rows] ** 2 + rounding)
        if batch.reading_covariance is not None:
            correlated = batch.reading_covariance[np.ix_(rows, rows)]
            noise += correlated - np.diag(batch.sigma[rows] ** 2)
        unknown = np.concatenate(
            [slope @ np.linalg.cholesky(batch.prior), likelihood.nuisance_at(mean)[first:]], axis=1
        )
        evidence = _evidence(
            noise,
            _shapes(batch.part(rows), channel, self.length),
            self.sigma**2,
            residual[first:] - slope @ mean,
            np.ascontiguousarray(unknown),
            likelihood.first_new - first,
        )
        return replace(self, log_weight=self.log_weight + evidence, batches=self.batches + 1)

    def figures(self, base: NoiseModel) -> dict[str, float]:
        """Return the estimate for the diagnostics."""
        model = self.model(base)
        return {"map_sigma": model.map_sigma, "map_correlation_length_m": model.correlation_length}


@kernel
def _means(sigma, length, log_weight):  # type: ignore[no-untyped-def]
    """Return mean sigma and the exponential of the mean log length of a posterior's log weights
    (S, L).

    Over sigmas four times as dense, by parabolas through three neighbours: many good readings
    know sigma better than the grid."""
    count, top = sigma.shape[0], log_weight.max()
    fine = 4 if count > 2 else 1
    total = of_sigma = of_length = 0.0
    for i in range(count):
        m = min(max(i, 1), count - 2) if fine > 1 else i  # the middle one of three
        for part in range(fine):
            away, there = 0.0, sigma[i]
            if fine > 1:
                away = i - m + 0.25 * (part - 2)
                there = sigma[m] * (sigma[m + 1] / sigma[m]) ** away
            for j in range(length.shape[0]):
                log = log_weight[m, j]
                if fine > 1:
                    below, above = log_weight[m - 1, j], log_weight[m + 1, j]
                    bend = above - 2.0 * log + below
                    log += 0.5 * (above - below) * away + 0.5 * bend * away * away
                weight = math.exp(log - top)
                total += weight
                of_sigma += weight * there
                of_length += weight * math.log(length[j])
    return of_sigma / total, math.exp(of_length / total)


def _doubt(estimate: MapErrorEstimate) -> float:
    above = estimate.sigma > 1.001 * estimate.doubtful
    if above.all() or not above.any():
        return 0.0
    return _log_mean(estimate.log_weight[above], estimate.prior[above]) - _log_mean(
        estimate.log_weight[~above], estimate.prior[~above]
    )


def _log_mean(log_weight: Array, log_prior: Array) -> float:
    """Return the log of the mean evidence under the prior, which need not be normalised."""
    top = float(log_weight.max())
    return top + math.log(float(np.exp(log_weight - top).sum() / np.exp(log_prior).sum()))


def _shapes(batch: Batch, channel: Integers, lengths: Array) -> Array:
    """Return (L, T, T) the covariance of the map's errors of a batch's readings for each length,
    in units of sigma²."""
    if batch.of_one_potential is not None:
        there = displacements(batch.latitude, batch.longitude)
        return np.stack(
            [
                tensor_covariance(batch.of_one_potential, channel, there, length)
                for length in lengths
            ]
        )
    apart = distances(batch.latitude, batch.longitude)
    shapes = np.stack([map_correlation(apart, length, batch.filter_path) for length in lengths])
    return shapes if batch.channel is None else shapes * (channel[:, None] == channel)


def roughness(field_map: FieldMap) -> float:
    """Return the RMS difference of a node from the mean of its neighbours on either side: what
    the map would not show if it were half as dense, by at most 200 x 200 nodes.
    """
    steps = [max(1, count // 200) for count in field_map.values.shape]
    values = field_map.values
    along = values[1:-1] - 0.5 * (values[2:] + values[:-2])
    across = values[:, 1:-1] - 0.5 * (values[:, 2:] + values[:, :-2])
    parts = [part[:: steps[0], :: steps[1]].ravel() for part in (along, across)]
    known = np.concatenate(parts)
    known = known[np.isfinite(known)]
    return math.sqrt(float((known**2).mean())) if known.size else 0.0


def differs(a: NoiseModel, b: NoiseModel, factor: float = CONSTANTS.changed_noise_factor) -> bool:
    """Whether two noise models differ by more than a factor in the map error's sigma or length."""
    ratios = a.map_sigma / b.map_sigma, a.correlation_length / b.correlation_length
    return any(abs(math.log(ratio)) > math.log(factor) for ratio in ratios)


@kernel
def _evidence(noise, shapes, variances, residual, unknown, first):  # type: ignore[no-untyped-def]
    """Return (S, L) log densities of the last residuals given the first ones, without the
    constant.

    Residuals (n,) are N(0, noise + variance shape + unknown unknown'), unknown (n, m); only
    the residuals from `first` on know the unknowns. With the factor of noise + variance shape the
    last whitened rows are N(0, 1 + A A') (Woodbury).
    """
    n, m = unknown.shape
    out = np.empty((variances.shape[0], shapes.shape[0]))
    factor = np.empty((n, n))
    w = np.empty((n, m + 1))
    inner = np.empty((m, m))
    seen = np.empty(m)
    for i in range(variances.shape[0]):
        for j in range(shapes.shape[0]):
            total = 0.0
            for a in range(n):
                for c in range(m):
                    w[a, c] = unknown[a, c]
                w[a, m] = residual[a]
                for b in range(a + 1):
                    value = variances[i] * shapes[j, a, b] + noise[a, b]
                    for c in range(b):
                        value -= factor[a, c] * factor[b, c]
                    if a == b:
                        factor[a, a] = math.sqrt(value)
                    else:
                        factor[a, b] = value / factor[b, b]
                        for c in range(m + 1):
                            w[a, c] -= factor[a, b] * w[b, c]
                for c in range(m + 1):
                    w[a, c] /= factor[a, a]
                if a >= first:
                    total += 0.5 * w[a, m] * w[a, m] + math.log(factor[a, a])
            for a in range(m):
                seen[a] = 0.0
                for t in range(first, n):
                    seen[a] += w[t, a] * w[t, m]
                for b in range(a + 1):
                    value = 1.0 if a == b else 0.0
                    for t in range(first, n):
                        value += w[t, a] * w[t, b]
                    for c in range(b):
                        value -= inner[a, c] * inner[b, c]
                    if a == b:
                        inner[a, a] = math.sqrt(value)
                    else:
                        inner[a, b] = value / inner[b, b]
                        seen[a] -= inner[a, b] * seen[b]
                seen[a] /= inner[a, a]
                total += math.log(inner[a, a]) - 0.5 * seen[a] * seen[a]
            out[i, j] = -total
    return out
