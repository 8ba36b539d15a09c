"""Hypotheses about what nobody has told: a navigator worse than assumed, fixes worse than they
say, readings that are late.

A bank of linear filters that run beside the navigator and take the information of its fixes
(multiple-model adaptive estimation; Magill 1965, IEEE TAC 10:434; Bar-Shalom, Li & Kirubarajan
2001, section 11.6). Each has the navigator's error model with one change and says how well it
foretells the fixes. Docs/mathematics.md, section 8.8.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.interfaces import LOST_COVARIANCE, Information
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matrices import eigen, inverse_of_lower, lower, product, symmetric

LEAST_INFORMATION = 1e-6
"""In units of the navigator's own, beside rounding."""
TELLING = CONSTANTS.telling_information  # kernels take constants of their module


@dataclass(frozen=True, slots=True, eq=False)
class ErrorHypotheses:
    """K hypotheses about the navigator's error x (7,) at a batch end, after its fix, and about the
    delay (s) of the readings."""

    navigator: Array
    """(K,) factor of all that the navigator's covariance grows by; at the start it has the same or
    none."""
    noise: Array
    """(K,) factor of the covariance of fixes."""
    mean: Array
    """(K, 8) of x and the delay; x relative to the navigator's estimate."""
    covariance: Array
    """(K, 8, 8)."""
    log_weight: Array
    """(K,) log of prior probability times evidence so far; that of the assumptions as they are,
    the first, begins at 0."""

    @classmethod
    def before(cls, prior: Array) -> "ErrorHypotheses":
        """Return the bank of a navigator whose covariance (7, 7) is the prior, before its first
        fix."""
        factors = [
            (navigator, navigator, noise, 0.0)
            for noise in CONSTANTS.fix_variance_factors
            for navigator in CONSTANTS.navigator_variance_factors
        ]
        factors += [
            (1.0, 1.0, noise, CONSTANTS.unknown_delay_s)
            for noise in CONSTANTS.fix_variance_factors
        ]
        factors += [(1.0, growth, 1.0, 0.0) for growth in CONSTANTS.growth_variance_factors]
        start, navigator, noise, delay = (
            np.array(column) for column in zip(*factors, strict=True)
        )
        covariance = np.zeros((len(delay), BATCH_STATES + 1, BATCH_STATES + 1))
        covariance[:, :-1, :-1] = start[:, None, None] * prior
        covariance[:, -1, -1] = delay**2
        log_weight = np.full(len(delay), CONSTANTS.untold_log_prior)
        log_weight[0] = 0.0
        return cls(navigator, noise, np.zeros(covariance.shape[:2]), covariance, log_weight)

    def grown(self, forward: Array, growth: Array, more: Array) -> "ErrorHypotheses":
        """Carry the bank to the next batch end.

        Parameters
        ----------
        forward : (7, 7) array
            Error there per unit of error here.
        growth : (7, 7) array
            What the navigator's covariance has grown by beside that, by its sensors' errors.
        more : (7, 7) array
            And for other reasons: the same for all hypotheses.
        """
        mean, covariance = _grown(
            self.mean, self.covariance, self.navigator, np.ascontiguousarray(forward), growth, more
        )
        return replace(self, mean=mean, covariance=covariance)

    def informed(
        self, information: Information, prior: Array, velocity: Array
    ) -> "ErrorHypotheses":
        """Take what a fix says; the error stays relative to the estimate before it.

        Parameters
        ----------
        information : Information
            About the error as the readings show it, n = 7.
        prior : (7, 7) array
            The navigator's own covariance, before the fix.
        velocity : (2,) array
            North and east, m/s: late readings show the vehicle where it was.
        """
        matrix = np.ascontiguousarray(information.matrix)
        z, H, telling = _as_measurement(information.vector, matrix, prior, velocity)
        mean, covariance, density = _informed(
            self.mean, self.covariance, self.noise, z, H, telling
        )
        # what was wrong for hours may become right: no hypothesis falls too far behind
        log_weight = self.log_weight + density
        log_weight = np.maximum(log_weight - log_weight.max(), -CONSTANTS.untold_reach_log)
        return replace(self, mean=mean, covariance=covariance, log_weight=log_weight)

    def lost(self) -> "ErrorHypotheses":
        """Return the bank where a navigator that is as assumed must be lost, and has become as
        uncertain."""
        covariance, log_weight = self.covariance.copy(), self.log_weight.copy()
        covariance[0, :-1, :-1] += LOST_COVARIANCE
        log_weight[0] += CONSTANTS.untold_log_prior
        return replace(self, covariance=covariance, log_weight=log_weight)

    def moved(self, by: Array) -> "ErrorHypotheses":
        """Return the bank beside a navigator that has taken an error (7,) off its estimate."""
        mean = self.mean.copy()
        mean[:, :-1] -= by
        return replace(self, mean=mean)

    @property
    def probability(self) -> Array:
        """(K,) of each hypothesis."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(weight / weight.sum())

    def believed(self) -> tuple[Array, Array]:
        """Return mean (8,) and covariance (8, 8) of the navigator's error and the delay, of all
        hypotheses together."""
        weight = self.probability
        mean = weight @ self.mean
        apart = self.mean - mean
        spread = np.einsum("k,ki,kj->ij", weight, apart, apart)
        return mean, symmetric(np.einsum("k,kij->ij", weight, self.covariance) + spread)

    def figures(self) -> dict[str, float]:
        """Return what the diagnostics say."""
        weight = self.probability
        return {
            "as_assumed": float(weight[0]),
            "navigator_sigma_factor": float(np.exp(0.5 * weight @ np.log(self.navigator))),
            "fix_sigma_factor": float(np.exp(0.5 * weight @ np.log(self.noise))),
            "delay": float(weight @ self.mean[:, -1]),
        }


def with_delay(velocity: Array) -> Array:
    """Return (7, 8) the error that readings show per unit of the navigator's error and of their
    delay (s), of a vehicle with a velocity (2,) in m/s."""
    shown = np.eye(BATCH_STATES, BATCH_STATES + 1)
    shown[:2, -1] = velocity
    return shown


@kernel
def _grown(mean, covariance, factor, forward, growth, more):  # type: ignore[no-untyped-def]
    """Return means (K, n + 1) and covariances (K, n + 1, n + 1) of `ErrorHypotheses.grown`; the
    last state, the delay, stays as it is."""
    count, n = mean.shape[0], forward.shape[0]
    new_mean, new = np.zeros(mean.shape), np.zeros(covariance.shape)
    half = np.empty((n, n))
    for k in range(count):
        P, Q = covariance[k], new[k]
        new_mean[k, n], Q[n, n] = mean[k, n], P[n, n]
        for i in range(n):
            for j in range(n):
                new_mean[k, i] += forward[i, j] * mean[k, j]
                Q[n, i] += forward[i, j] * P[n, j]
                half[i, j] = 0.0
                for c in range(n):
                    half[i, j] += forward[i, c] * P[c, j]
            Q[i, n] = Q[n, i]
        for i in range(n):
            for j in range(i + 1):
                value = factor[k] * growth[i, j] + more[i, j]
                for c in range(n):
                    value += half[i, c] * forward[j, c]
                Q[i, j] = Q[j, i] = value
    return new_mean, new


@kernel
def _as_measurement(vector, matrix, prior, velocity):  # type: ignore[no-untyped-def]
    """Return z (m,) and H (m, 8) of information about the error as readings show it, z = H (error,
    delay) + N(0, I), in the directions in which it is positive, and in how many, the first, it
    tells so much that it may be judged; `prior` (7, 7) is the navigator's own covariance."""
    n = vector.shape[0]
    scaled, root, turned = np.empty((n, n)), np.empty((n, n)), np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            scaled[i, j] = prior[i, j] / math.sqrt(prior[i, i] * prior[j, j])
    factor = lower(scaled)
    for i in range(n):
        for j in range(n):
            root[i, j] = math.sqrt(prior[i, i]) * factor[i, j]
    whole = product(matrix, root)
    for i in range(n):
        for j in range(n):
            for c in range(n):
                turned[i, j] += root[c, i] * whole[c, j]
    values, vectors = eigen(turned)
    back = inverse_of_lower(root)
    kept = telling = 0
    for k in range(n):
        kept += values[k] > LEAST_INFORMATION
        telling += values[k] > TELLING
    z, H = np.zeros(kept), np.zeros((kept, n + 1))
    for a in range(kept):
        k = n - 1 - a
        size = math.sqrt(values[k])
        for i in range(n):
            for c in range(n):
                z[a] += vectors[i, k] * root[c, i] * vector[c] / size
                H[a, c] += size * vectors[i, k] * back[i, c]
        H[a, n] = H[a, 0] * velocity[0] + H[a, 1] * velocity[1]
    return z, H, telling


@kernel
def _joseph(P, gain, H, noise, left, half, out):  # type: ignore[no-untyped-def]
    """Write the covariance (n, n) after a measurement H (m, n) with a transposed gain (m, n), in
    Joseph's form: what is left of a wide covariance is not lost in rounding. `left` and `half`
    (n, n) are work space."""
    m, n = H.shape
    for i in range(n):
        for j in range(n):
            left[i, j] = 1.0 if i == j else 0.0
            for a in range(m):
                left[i, j] -= gain[a, i] * H[a, j]
    for i in range(n):
        for j in range(n):
            half[i, j] = 0.0
            for c in range(n):
                half[i, j] += left[i, c] * P[c, j]
    for i in range(n):
        for j in range(i + 1):
            value = 0.0
            for c in range(n):
                value += half[i, c] * left[j, c]
            for a in range(m):
                value += noise * gain[a, i] * gain[a, j]
            out[i, j] = out[j, i] = value


@kernel
def _informed(means, covariances, noises, z, H, telling):  # type: ignore[no-untyped-def]
    """Return means (K, n), covariances (K, n, n) and log densities (K,), without their constant,
    of hypotheses that are told z (m,) = H x + N(0, noise), H (m, n): a Kalman filter each. The
    density is of the first `telling` of z."""
    m, n = H.shape
    out_mean, out = means.copy(), np.empty_like(covariances)
    density = np.zeros(noises.shape[0])
    cross, gain, root = np.empty((m, n)), np.empty((m, n)), np.empty((m, m))
    white, left, half = np.empty(m), np.empty((n, n)), np.empty((n, n))
    for k in range(noises.shape[0]):
        P = covariances[k]
        for a in range(m):
            white[a] = z[a]
            for i in range(n):
                white[a] -= H[a, i] * means[k, i]
                cross[a, i] = 0.0
                for j in range(n):
                    cross[a, i] += H[a, j] * P[j, i]
            for b in range(a + 1):  # Cholesky factor of S = H P H' + noise
                value = noises[k] if a == b else 0.0
                for i in range(n):
                    value += cross[a, i] * H[b, i]
                for c in range(b):
                    value -= root[a, c] * root[b, c]
                root[a, b] = math.sqrt(value) if a == b else value / root[b, b]
            for b in range(a):
                white[a] -= root[a, b] * white[b]
            white[a] /= root[a, a]
            if a < telling:
                density[k] -= 0.5 * white[a] * white[a] + math.log(root[a, a])
            for i in range(n):
                gain[a, i] = cross[a, i]
                for b in range(a):
                    gain[a, i] -= root[a, b] * gain[b, i]
                gain[a, i] /= root[a, a]
                out_mean[k, i] += gain[a, i] * white[a]
        for a in range(m - 1, -1, -1):  # S^-1 H P, transposed
            for i in range(n):
                for b in range(a + 1, m):
                    gain[a, i] -= root[b, a] * gain[b, i]
                gain[a, i] /= root[a, a]
        _joseph(P, gain, H, noises[k], left, half, out[k])
    return out_mean, out, density
