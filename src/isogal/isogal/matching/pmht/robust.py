"""Fixes that do not rest on the noise model alone: `pmht`'s, looked at twice.

Maps are more wrong where the field varies more, their errors are not quite Gaussian, and nobody
knows their correlation function. Two things follow, and neither of them narrows a fix.

Which place it is. Evidence between places kilometres apart counts every reading with the noise
assumed. From a prior wide enough to hold several (`hypotheses.WIDE`) a fix is published only if
the same place is the likely one with twice the noise as well, which is what a model wrong by two
in sigma explains.

How well it is known there. Where the noise model is wrong the curvature of the likelihood is not
the covariance of its peak; the sandwich H⁻¹ J H⁻¹ is (Huber 1967, Proc. 5th Berkeley Symp.
1:221-233; White 1982, Econometrica 50(1):1-25). With whitened residuals w and their derivatives G
by the navigator's error, H = G'G, and J is the covariance of the score G'w, which the residuals
show themselves:

    J = sum_t s_t s_t' + sum_k (1 - k / (m + 1)) sum_t (s_t s_{t-k}' + s_{t-k} s_t'),   s_t = w_t G_t,

(Newey & West 1987, Econometrica 55(3):703-708; m = 4 (n / 100)^(2/9), their rule of 1994, Rev.
Econ. Stud. 61(4):631-653; residuals over sqrt(1 - leverage), MacKinnon & White 1985, J.
Econometrics 29(3):305-325). If the noise model is right J is H but for chance. So only what J has
more than H, beyond two 1-sigmas of that chance, widens a fix."""

from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.maps.field_map import FieldMap
from isogal.matching.information import positive_part
from isogal.matching.interfaces import Batch, Fix, Information, declined
from isogal.matching.pmht.hypotheses import WIDE
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.memory import Memory, Scale

_DOUBT = 4.0
"""Variance factor of twice the noise."""
_CONFIDENCE = 0.9
"""Probability that the place needs with it."""
_INFORMED = 0.01
"""Information in units of the prior's under which a direction is not looked at."""
_CHANCE = 2.0
"""1-sigmas by which J must exceed H."""


def confirmed(
    fix: Fix,
    after: Memory,
    before: Memory | None,
    batch: Batch,
    field_map: FieldMap,
    matcher: Pmht,
) -> tuple[Fix, Memory]:
    """Return a published fix and the memory after it, or why twice the noise leaves it open, and
    the hypotheses for the next batch.

    Parameters
    ----------
    fix : Fix
    after, before : Memory
        What the matcher knows after and before the batch.
    batch : Batch
        That the fix was made from.
    """
    if np.linalg.eigvalsh(batch.prior[:2, :2])[-1] < WIDE**2:
        return fix, after
    noise = matcher.noise if after.noise is None else after.noise.model(matcher.noise)
    unit = Scale()
    scale = Scale(_DOUBT * (before.scale.factor if before else 1.0) * unit.freedom, unit.freedom)
    start = before or Memory(time=float(batch.time[0]), prior=batch.prior, belief=None)
    letter = matcher.settings.model_copy(update={"confidence": _CONFIDENCE, "trust": 1.0})
    doubter = replace(matcher, adaptive=False, noise=noise, settings=letter)
    doubtful, memory = doubter.match(batch, field_map, replace(start, noise=None, scale=scale))
    if memory is None or (doubtful.published and _near(fix, doubtful)):
        return fix, after
    reason = doubtful.reason or "that finds it elsewhere"
    return declined(
        batch, f"not found with twice the noise: {reason}", **fix.diagnostics
    ), replace(after, belief=memory.belief)


def _near(fix: Fix, other: Fix) -> bool:
    """Whether a fix lies within three 1-sigmas of another."""
    apart = horizontal_difference(fix.latitude, fix.longitude, other.latitude, other.longitude)
    return float(apart @ np.linalg.solve(other.covariance, apart)) < 9.0


def widened(
    fix: Fix,
    after: Memory,
    batch: Batch,
    field_map: FieldMap,
    matcher: Pmht,
    mean: Array,
    covariance: Array,
) -> Fix:
    """Return a published fix with a covariance that the residuals agree with.

    Parameters
    ----------
    fix, after, batch
        As for `confirmed`.
    mean, covariance : (4,), (4, 4) arrays
        Of the batch's error, prior and fix together.
    """
    noise = matcher.noise if after.noise is None else after.noise.model(matcher.noise)
    used = replace(
        batch, reading=np.where(np.isin(batch.time, list(after.excluded)), np.nan, batch.reading)
    )
    likelihood = BatchLikelihood.of(used, field_map, noise, belief=(mean, covariance)).scaled(
        after.scale.factor
    )
    residual, slope = likelihood.linearise(mean)
    if not np.isfinite(residual).all():
        return fix
    new = slice(likelihood.first_new, None)
    whitened: Array = np.asarray(np.linalg.solve(likelihood.factor, residual), dtype=np.float64)
    derivative: Array = np.asarray(np.linalg.solve(likelihood.factor, slope), dtype=np.float64)
    excess = excess_covariance(whitened[new], derivative[new], batch.prior)
    return _with_excess(fix, excess, batch.new)


def excess_covariance(whitened: Array, slope: Array, prior: Array) -> Array:
    """Return (k, k) what the sandwich covariance has more than the inverse curvature; zeros where
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
    informed = values > _INFORMED
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
    more = np.where(factors > 1.0 + _CHANCE * chance, factors - 1.0, 0.0)
    along = axes @ turn
    return np.asarray((along * more) @ along.T, dtype=np.float64)


def _bartlett(count: int) -> Array:
    """Return (n, n) weights of pairs of readings by their distance in the order of the track."""
    lags = int(4.0 * (count / 100.0) ** (2.0 / 9.0))
    apart = np.abs(np.arange(count)[:, None] - np.arange(count))
    return np.maximum(1.0 - apart / (lags + 1.0), 0.0)


def _with_excess(fix: Fix, excess: Array, scans: int) -> Fix:
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
        information = Information(vector=vector, matrix=0.5 * (matrix + matrix.T))
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
