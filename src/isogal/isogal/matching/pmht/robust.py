"""Monitor of recorded tracks: fixes that do not rest on the noise model alone.

Maps are more wrong where the field varies more, their errors are not quite Gaussian, and their
correlation function is unknown. Two checks follow, neither of which narrows a fix
(docs/mathematics.md, section 10.2).

Place. Evidence between places kilometres apart counts every reading with the noise assumed. From
a prior wide enough to hold several places a fix is published only if the same place is the likely
one with twice the noise as well, which is what a model wrong by a factor of two explains.

Covariance. Where the noise model is wrong, the inverse curvature of the likelihood is not the
covariance of its peak; the sandwich H⁻¹ J H⁻¹ is (Huber 1967, Proc. 5th Berkeley Symp. 1:221-233;
White 1982, Econometrica 50(1):1-25). With whitened residuals w and their derivatives G by the
navigator's error, H = G'G, and J is the covariance of the score G'w with the terms s_t = w_t G_t,
estimated from the residuals:

    J = sum_t s_t s_t' + sum_k (1 - k / (m + 1)) sum_t (s_t s_{t-k}' + s_{t-k} s_t')

(Newey & West 1987, Econometrica 55(3):703-708; m = 4 (n / 100)^(2/9), their rule of 1994, Rev.
Econ. Stud. 61(4):631-653; residuals over sqrt(1 - leverage), MacKinnon & White 1985, J.
Econometrics 29(3):305-325). If the noise model is right, J is H but for chance, so a direction is
widened only where J exceeds H by more than two 1-sigmas of that chance.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.maps.channels import AnyMap
from isogal.matching.information import posterior_of
from isogal.matching.interfaces import Batch, Fix, Information, declined
from isogal.matching.monitoring import Monitor, Monitored
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matrices import positive_part, symmetric


@dataclass(frozen=True)
class TrackMonitor(Monitor):
    """A matcher of recorded tracks that publishes only what passes both checks."""

    matcher: Monitored

    def match(self, batch: Batch, field_map: AnyMap, memory: Any) -> tuple[Fix, Any]:
        """Match one batch; see `interfaces.Matcher`."""
        fix, after = self.matcher.match(batch, field_map, memory)
        if fix.published:
            fix, after = self.confirmed(fix, batch, field_map, memory, after)
        if fix.published:
            fix = self.widened(fix, batch, field_map, after)
        return fix, after

    def confirmed(
        self, fix: Fix, batch: Batch, field_map: AnyMap, before: Any, after: Any
    ) -> tuple[Fix, Any]:
        """Return a published fix and the memory after it; or why it is not confirmed with twice
        the noise, and the hypotheses that this leaves open.

        Parameters
        ----------
        fix, batch
            The fix, and the batch that it was made from.
        before, after
            What the matcher remembers before and after the batch.
        """
        if np.linalg.eigvalsh(batch.prior[:2, :2])[-1] < CONSTANTS.wide_prior_m**2:
            return fix, after
        sceptic, start = self.matcher.sceptic(
            batch,
            before,
            after,
            CONSTANTS.sceptical_variance_factor,
            CONSTANTS.sceptical_confidence,
        )
        other, memory = sceptic.match(batch, field_map, start)
        if memory is None or (other.published and _near(fix, other)):
            return fix, after
        reason = f"not found with twice the noise: {other.reason or 'that finds it elsewhere'}"
        after = self.matcher.with_hypotheses(after, of=memory)
        return declined(batch, reason, **fix.diagnostics), after

    def widened(self, fix: Fix, batch: Batch, field_map: AnyMap, after: Any) -> Fix:
        """Return a published fix with a covariance that the residuals agree with."""
        mean, covariance = posterior_of(fix, batch)
        likelihood = self.matcher.likelihood(batch, field_map, after, (mean, covariance))
        residual, slope = likelihood.linearise(mean)
        if not np.isfinite(residual).all():
            return fix
        white = likelihood.whitened(np.column_stack([residual, slope]))
        excess = excess_covariance(white[:, 0], white[:, 1:], batch.prior)
        return with_excess(fix, excess, batch.new)


def _near(fix: Fix, other: Fix) -> bool:
    """Whether a fix lies within three 1-sigmas of another."""
    apart = horizontal_difference(fix.latitude, fix.longitude, other.latitude, other.longitude)
    return float(apart @ np.linalg.solve(other.covariance, apart)) < 9.0


def excess_covariance(whitened: Array, slope: Array, prior: Array) -> Array:
    """Return (k, k) the excess of the sandwich covariance over the inverse curvature; zeros where
    the residuals fit the noise model.

    Parameters
    ----------
    whitened : (n,) array
        Residuals, N(0, 1) each if the noise model is right, in the order of the track.
    slope : (n, k) array
        Their derivatives by the error.
    prior : (k, k) array
        Covariance of the error without them; directions about which they tell next to nothing are
        left alone.
    """
    scale = np.linalg.cholesky(prior)
    values, vectors = np.linalg.eigh(scale.T @ slope.T @ slope @ scale)
    informed = values > CONSTANTS.informed_share
    if not informed.any():
        return np.zeros_like(prior)
    axes = (scale @ vectors[:, informed]) / np.sqrt(values[informed])  # of H⁻¹
    unit = slope @ axes
    leverage = np.minimum((unit**2).sum(axis=1), 0.5)
    score = unit * (whitened / np.sqrt(1.0 - leverage))[:, None]
    weight = _bartlett(len(whitened))
    factors, turn = np.linalg.eigh(score.T @ weight @ score)
    chance = np.sqrt(
        2.0 * np.einsum("ti,tu,ui->i", (unit @ turn) ** 2, weight**2, (unit @ turn) ** 2)
    )
    more = np.where(factors > 1.0 + CONSTANTS.sandwich_sigma * chance, factors - 1.0, 0.0)
    along = axes @ turn
    return np.asarray((along * more) @ along.T, dtype=np.float64)


def _bartlett(count: int) -> Array:
    """Return (n, n) weights of pairs of readings by their distance in the order of the track."""
    lags = int(4.0 * (count / 100.0) ** (2.0 / 9.0))
    apart = np.abs(np.arange(count)[:, None] - np.arange(count))
    return np.maximum(1.0 - apart / (lags + 1.0), 0.0)


def with_excess(fix: Fix, excess: Array, scans: int) -> Fix:
    """Return the fix with more covariance about the same place."""
    if not excess.any():
        return fix
    information = fix.information
    if information is not None:
        # (M⁻¹ + E)⁻¹, and the vector that keeps M⁻¹ vector, where M may be singular; directions
        # without information stay without
        size = np.sqrt(np.maximum(np.abs(np.diag(information.matrix)), 1e-300))
        told = positive_part(information.matrix, size)
        spread = np.eye(len(excess)) + told @ excess
        matrix = np.asarray(np.linalg.solve(spread, told), dtype=np.float64)
        vector = np.asarray(np.linalg.solve(spread, information.vector), dtype=np.float64)
        information = Information(vector=vector, matrix=symmetric(matrix))
    return replace(
        fix,
        covariance=fix.covariance + excess[:2, :2],
        information=information,
        scan_covariance=(
            None if fix.scan_covariance is None else fix.scan_covariance + excess[:2, :2] * scans
        ),
        diagnostics={
            **fix.diagnostics,
            "widened": float(np.sqrt(np.trace(excess[:2, :2]) / np.trace(fix.covariance))),
        },
    )
