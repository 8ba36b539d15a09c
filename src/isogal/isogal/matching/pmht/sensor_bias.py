"""The readings' bias and drift, and how late they are, estimated from batch to batch beside the
navigator's error.

State: theta = (bias at a time, drift per second, where it is in question the delay of the readings
in s beyond what is told, and the parameters of `isogal.matching.parameters`), Gaussian given the
navigator's error x there (position, velocity and, where the batch knows it, attitude): theta =
mean + gain x + N(0, covariance). The gain is what matters: a bias looks like a position error
along the map's gradient, and what a batch leaves unknown of one goes together with what it leaves
unknown of the other. For a batch the state is the linear part of what the readings contain beside
the map: `reading_jacobian` by xi, and unit-variance columns of `nuisance_reading`, which the
likelihood integrates out (`batching`, `likelihood`): a Schmidt filter (Jazwinski 1970, section
8.4) whose considered parameters are estimated after all.

A bias that walks has grown by w sqrt(D) u3 at the end of a batch, D after the last one, of which
a share t / D was there at time t; around this line the walk is a Brownian bridge of covariance w²
(min(s, t) - s t / D), independent of u3, which joins the readings' noise. Parameters that change
are carried likewise (`wandering`).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.interfaces import Batch
from isogal.matching.parameters import Parameters
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.delay import by_delay, later
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.taken import has_taken
from isogal.matching.pmht.wandering import Walk, Wandering
from isogal.matching.transitions import unconditioned
from isogal.matrices import square_root, symmetric

_DELAY = "reading_delay"
"""Not what `error_hypotheses` says of a delay that nobody has told of."""
_NAMES: tuple[str, ...] = ("bias", "drift")


@dataclass(frozen=True, slots=True, eq=False)
class BiasEstimate:
    """theta (k,), k = 2, 3 with a delay, more with parameters, given the navigator's error x (n,)
    at a time, n = 4 or 7. Map's unit, s."""

    time: float
    mean: Array
    """(k,) at x = 0."""
    covariance: Array
    """(k, k) given x."""
    gain: Array
    """(k, n)."""
    error: Array | None = None
    """(n, n) the navigator's covariance of x at that time if it has taken the fix that was
    published; None = there was none."""
    names: tuple[str, ...] = _NAMES
    """Of the first states, for the diagnostics."""

    @classmethod
    def unknown(
        cls,
        time: float,
        bias_sigma: float,
        drift_sigma: float,
        delay_sigma: float = 0.0,
        parameters: Parameters | None = None,
    ) -> "BiasEstimate":
        """Return the prior at a time; without a delay where its sigma is 0."""
        sigma, names = np.array([bias_sigma, drift_sigma]), _NAMES
        if delay_sigma > 0.0:
            sigma, names = np.append(sigma, delay_sigma), (*names, _DELAY)
        if parameters is not None:
            sigma, names = np.append(sigma, parameters.sigma), (*names, *parameters.names)
        prior = np.diag(sigma**2)
        return cls(time, np.zeros(len(sigma)), prior, np.zeros((len(sigma), 4)), names=names)

    def simplified(self, prior: tuple[float, float]) -> "BiasEstimate | None":
        """Return the state without what the readings say is not there: drift, or bias and drift
        (None), where they are the more likely for having none (docs/mathematics.md, section 9.3).

        Parameters
        ----------
        prior : (float, float)
            1-sigma of bias and drift before the first reading; 0 = known to be none.
        """
        covariance = self.covariance
        if self.error is not None:
            covariance = covariance + self.gain @ self.error @ self.gain.T
        open_states = np.flatnonzero(np.array(prior) > 0.0)
        every = _log_zero(self.mean, covariance, prior, open_states)
        if every > CONSTANTS.no_bias_log_evidence:
            return None
        drift = open_states[open_states == 1]
        if drift.size and len(open_states) > 1 and covariance[1, 1] > 0.0:
            none = _log_zero(self.mean, covariance, prior, drift)
            return (
                self._without_drift(covariance) if none > CONSTANTS.no_bias_log_evidence else self
            )
        return self

    def _without_drift(self, covariance: Array) -> "BiasEstimate":
        """Return the state given that there is no drift."""
        if self.error is None:
            gain = self.covariance[0, 1] / max(self.covariance[1, 1], 1e-300)
            mean = np.array([self.mean[0] - gain * self.mean[1], 0.0])
            own = np.diag([self.covariance[0, 0] - gain * self.covariance[0, 1], 0.0])
            kept = np.stack([self.gain[0] - gain * self.gain[1], np.zeros(self.gain.shape[1])])
            return replace(self, mean=mean, covariance=own, gain=kept)
        # (bias, error) given the drift, of their joint Gaussian; the navigator keeps its own
        gain = covariance[0, 1] / covariance[1, 1]
        cross = self.gain @ self.error
        left = cross[0] - gain * cross[1]
        kept = np.linalg.solve(self.error, left)
        variance = covariance[0, 0] - gain * covariance[0, 1] - kept @ left
        return replace(
            self,
            mean=np.array([self.mean[0] - gain * self.mean[1], 0.0]),
            covariance=np.diag([max(float(variance), 0.0), 0.0]),
            gain=np.stack([kept, np.zeros_like(kept)]),
        )

    def at_end(self, batch: Batch) -> "LinearBias":
        """Carry the state to the end of a batch."""
        end = float(batch.time[-1])
        forward = np.eye(len(self.mean))
        forward[0, 1] = end - self.time
        wander = Wandering.of(batch.parameters, self.time, end)
        if wander is not None:
            each = np.arange(len(self.mean) - len(wander.kept), len(self.mean))
            forward[each, each] = wander.kept
        own = forward @ _root(self.covariance)
        mean, gain = forward @ self.mean, forward @ self.gain
        last = float(batch.time[-1 - batch.new]) if batch.new < len(batch) else math.nan
        back, drift = batch.back(end - self.time)
        walk = Walk(self.time, end, batch.bias_walk)
        states = gain.shape[1]
        back, drift = back[:states], drift[:states]
        if self._taken(last, back[:4] @ batch.prior @ back[:4].T + drift[:4] @ drift[:4].T):
            both = gain @ back, gain @ drift
            return LinearBias(
                end, mean, *both, _changed(own, walk, wander), walk, self.names, wander
            )
        # a batch is missing, or another correction was made than was published: how the errors go
        # together is not known any more
        before = np.zeros((states, states)) if self.error is None else self.error
        own = _root(own @ own.T + gain @ before @ gain.T)
        nothing = np.zeros((len(mean), 4)), np.zeros((len(mean), drift.shape[1]))
        return LinearBias(
            end, mean, *nothing, _changed(own, walk, wander), walk, self.names, wander
        )

    def _taken(self, last: float, then: Array) -> bool:
        if not self.gain.any() or abs(last - self.time) > 1e-6:
            return False
        if self.error is None:
            return True
        return has_taken(self.error[:4, :4], then)

    def figures(self) -> dict[str, float]:
        """Return the estimate for the diagnostics."""
        variance = np.diag(self.covariance)
        if self.error is not None:
            variance = variance + np.diag(self.gain @ self.error @ self.gain.T)
        return {
            name: float(value)
            for k, what in enumerate(self.names)
            for name, value in ((what, self.mean[k]), (f"{what}_sigma", np.sqrt(variance[k])))
        }


def _log_zero(
    mean: Array, covariance: Array, prior: tuple[float, float], which: Integers
) -> float:
    """Return the log Bayes factor for some of the states being zero: the posterior's density there
    over the prior's (Dickey 1971, Ann. Math. Stat. 42:204); -inf where none is in question."""
    if not which.size:
        return -math.inf
    part = covariance[np.ix_(which, which)]
    scale = np.array(prior)[which]
    unit = mean[which] / scale
    relative = part / np.outer(scale, scale) + 1e-12 * np.eye(len(which))
    square = unit @ np.linalg.solve(relative, unit)
    return float(-0.5 * square - 0.5 * np.linalg.slogdet(relative)[1])


@dataclass(frozen=True, slots=True, eq=False)
class LinearBias:
    """theta at a batch's end: mean + by_error xi + by_nuisance d + own u, with d the navigator's
    drift and u ~ N(0, 1) (k,), one more with a walk, and one for each parameter that changes.
    """

    time: float
    mean: Array
    """(k,)."""
    by_error: Array
    """(k, 4)."""
    by_nuisance: Array
    """(k, M)."""
    own: Array
    """(k, k) or with more columns."""
    walk: Walk
    names: tuple[str, ...]
    wander: Wandering | None = None

    def added_to(self, batch: Batch) -> Batch:
        """Return the batch whose readings are known to contain bias and drift, and to be late; u
        is more columns of its drift.
        """
        # of bias, drift, delay and parameters, in each reading
        shares = np.stack([np.ones(len(batch)), batch.time - self.time], axis=1)
        moves = np.zeros((len(batch), 2, len(self.mean)))
        if _DELAY in self.names:
            shares = np.column_stack([shares, by_delay(batch)])
            batch = later(batch, float(self.mean[2]))
            moves[:, :, 2] = batch.velocity
        if batch.parameters is not None:
            count = len(batch.parameters.sigma)
            carried = 1.0 if self.wander is None else self.wander.carried(batch.time)
            shares = np.column_stack([shares, batch.parameters.reading * carried])
            moves[:, :, -count:] = batch.parameters.moves
            batch = _moved(batch, moves[:, :, -count:] @ self.mean[-count:])
        own, covariance = shares @ self.own, batch.reading_covariance
        if self.walk.walks:
            own[:, len(self.mean)] *= self.walk.share(batch.time)
            white = np.diag(batch.sigma**2) if covariance is None else covariance
            covariance = white + self.walk.bridge(batch.time)
        if self.wander is not None and batch.parameters is not None:
            reading, which = batch.parameters.reading, self.wander.which
            arrived = reading[:, which] * self.wander.arrived(batch.time)
            own[:, -len(which) :] = arrived * self.wander.fresh
            white = np.diag(batch.sigma**2) if covariance is None else covariance
            covariance = white + self.wander.bridge(batch.time, reading)
        by_nuisance = batch.nuisance_position + moves @ self.by_nuisance
        return replace(
            batch,
            transition=np.ascontiguousarray(batch.transition + moves @ self.by_error),
            offset=batch.offset + shares @ self.mean,
            reading_jacobian=batch.reading_jacobian + shares @ self.by_error,
            nuisance_reading=np.concatenate(
                [batch.nuisance_reading + shares @ self.by_nuisance, own], axis=1
            ),
            nuisance_position=np.concatenate([by_nuisance, moves @ self.own], axis=2),
            reading_covariance=covariance,
        )

    def unmeasured(self, batch: Batch) -> BiasEstimate:
        """Return the state where the batch gave no fix: as carried."""
        gain, rest = _by_state(batch, self.by_error, self.by_nuisance)
        own = symmetric(self.own @ self.own.T + rest)
        return BiasEstimate(self.time, self.mean, own, gain, names=self.names)

    def measured(
        self, batch: Batch, likelihood: BatchLikelihood, whole: Array, covariance: Array
    ) -> BiasEstimate:
        """Return the state after a batch, for a navigator that takes the fix.

        Given xi and the navigator's drift d, u is the regression of the whitened new residuals w =
        -D d - U u + N(0, 1), linearised at the mean.

        Parameters
        ----------
        whole, covariance : (n,), (n, n) arrays
            Posterior of the navigator's error: of xi, or with attitude where the batch knows it.
        """
        mean = whole[:4]
        residual, slope = likelihood.linearise(mean)
        drift = likelihood.nuisance_at(mean)
        white = likelihood.whitened(np.column_stack([residual, slope, drift]))
        count = self.own.shape[1]
        U = white[:, -count:]
        inner = np.eye(count) + U.T @ U
        learnt = -self.own @ np.linalg.solve(inner, U.T @ white[:, :-count])  # by residual, xi, d
        by_nuisance = self.by_nuisance + learnt[:, 5:]
        gain, rest = _by_state(batch, self.by_error + learnt[:, 1:5], by_nuisance)
        expected = (
            likelihood.nuisance_given(mean)[0][:-count]
            if batch.attitude
            else np.zeros(by_nuisance.shape[1])
        )
        return BiasEstimate(
            self.time,
            self.mean + self.by_error @ mean + learnt[:, 0] + by_nuisance @ expected,
            symmetric(self.own @ np.linalg.solve(inner, self.own.T) + rest),
            gain,
            covariance,
            self.names,
        )


def _changed(own: Array, walk: Walk, wander: Wandering | None) -> Array:
    """Return the columns of theta's own noise with those of what walks or changes."""
    own = walk.added(own)
    if wander is None:
        return own
    columns = np.zeros((len(own), len(wander.which)))
    first = len(own) - len(wander.sigma)
    columns[first + wander.which, np.arange(len(wander.which))] = wander.fresh
    return np.column_stack([own, columns])


def _moved(batch: Batch, off: Array) -> Batch:
    """Return a batch whose places are known to be off by (T, 2) metres."""
    if not off.any():
        return batch
    north, east = metres_per_radian(batch.latitude)
    return replace(
        batch,
        latitude=batch.latitude - off[:, 0] / north,
        longitude=batch.longitude - off[:, 1] / east,
        end_place=batch.end,
    )


def _root(covariance: Array) -> Array:
    """Return a square root (k, k) of theta's covariance; a delay in s and a drift in m/s³ differ
    by too much for one set of eigenvalues."""
    if len(covariance) == 2:
        return square_root(covariance)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return scale[:, None] * square_root(covariance / scale / scale[:, None])


def _by_state(batch: Batch, by_error: Array, by_nuisance: Array) -> tuple[Array, Array]:
    """Turn a dependence (2, 4) on xi and (2, M) on the navigator's drift into one on its error
    state; and the covariance that is left.
    """
    if batch.attitude is None:
        return by_error, by_nuisance @ by_nuisance.T
    by_state = unconditioned(batch, by_error, by_nuisance)
    rest = by_nuisance - by_state[:, 4:] @ batch.attitude[1]
    return by_state, rest @ rest.T
