"""Monitor of what the navigator and the matcher have been told: is the navigator worse than it
says, are fixes worse than they say, are the readings late?

Beside the navigator runs a bank of hypotheses (`error_hypotheses`). While the assumptions as they
are foretell the fixes best, nothing is changed. Once another hypothesis is clearly ahead it leads:
batches are matched as its navigator would have them, and the real navigator is told what it
believes, mean and covariance (docs/mathematics.md, section 8.8).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import BATCH_STATES, batch_covariance
from isogal.maps.channels import AnyMap
from isogal.matching.information import measurement_only, replaced
from isogal.matching.interfaces import (
    LOST_COVARIANCE,
    Batch,
    Fix,
    Information,
    Matcher,
    declined,
)
from isogal.matching.monitoring import Monitor
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.delay import delayed
from isogal.matching.pmht.error_hypotheses import ErrorHypotheses, with_delay
from isogal.matching.pmht.past_batches import error_after, placeless, posterior_of, seen_from
from isogal.matrices import cholesky, inverted, positive, positive_part, product

CONTRADICTED_COVARIANCE = batch_covariance(500.0, 0.5, 1e-4, 1e-3)
"""(7, 7) what an aid that is not what it says may have done to the navigator besides what fixes
have shown: a current or a scale factor error, while fixes told little."""


class Forgetful(Matcher, Protocol):
    """A matcher that can be told that the navigator is another one than it believes."""

    def without_hypotheses(self, memory: Any) -> Any:
        """Return a memory that takes the navigator's own covariance for its prior."""
        ...

    def moved(self, memory: Any, by: Array, covariance: Array) -> Any:
        """Return the memory after a batch whose fix the navigator has not taken as it was: its
        estimate has lost an error (7,) and its covariance is (7, 7)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """What the monitor carries from batch to batch."""

    memory: Any = None
    """Of the matcher that it watches."""
    hypotheses: ErrorHypotheses | None = None
    """None = there has been no fix."""
    posterior: Array | None = None
    """(7, 7) of the navigator at the last batch end, after its fix."""
    in_doubt: bool = False
    """Whether the navigator believes what the hypotheses say, and not what it was told."""
    aided: bool = False
    """Whether other sensors have told the navigator its velocity."""
    growth: Array | None = None
    """(7, 7) what the navigator's covariance grew by between two batch ends, beside its dynamics,
    when it was last believed; None = not known."""


@dataclass(frozen=True)
class AssumptionsMonitor(Monitor):
    """A matcher that finds out what it should have been told. See the module."""

    matcher: Forgetful

    def match(self, batch: Batch, field_map: AnyMap, memory: Trial | None) -> tuple[Fix, Trial]:
        """Match one batch; see `interfaces.Matcher`."""
        trial = memory or Trial()
        carried = _carried(batch, trial)
        if carried is None:
            fix, inner = self.matcher.match(batch, field_map, trial.memory)
            return fix, Trial(inner, aided=trial.aided)
        bank, growth, aided = carried
        seen, shown = batch, np.zeros(BATCH_STATES)
        if trial.in_doubt:
            seen, shown = _as_seen(batch, bank)
        fix, inner = self.matcher.match(seen, field_map, trial.memory)
        own = prior = joint_prior(batch)
        if fix.reset and trial.in_doubt:
            return fix, Trial(inner)
        if fix.reset:
            prior, bank = prior + LOST_COVARIANCE, bank.lost()
        before, told = bank, fix.information if fix.published else None
        in_doubt = trial.in_doubt
        if told is not None:
            # relative to the navigator's own estimate, and of readings that are not late
            told = Information(told.vector + told.matrix @ shown, told.matrix)
            bank = bank.informed(told, prior, batch.velocity[-1])
            least, most = CONSTANTS.assumptions_probability
            in_doubt = bool(bank.probability[0] < (most if in_doubt else least))
        if in_doubt != trial.in_doubt or (in_doubt and fix.published):
            inner = self.matcher.without_hypotheses(inner)
        fix = replace(fix, diagnostics={**fix.diagnostics, **bank.figures()})
        if in_doubt or trial.in_doubt:
            whole, spread = bank.believed()
            mean, posterior = whole[:-1], spread[:-1, :-1]
            if aided and not trial.in_doubt:
                fix = _contradicted(batch, before, fix.diagnostics)
                assert fix.widening is not None
                inner = self.matcher.moved(inner, np.zeros(BATCH_STATES), own + fix.widening)
                return fix, Trial(inner)
            widening = positive_part(before.believed()[1][:-1, :-1] - own, np.sqrt(np.diag(own)))
            fix = _told(batch, fix, mean, posterior, widening)
        else:
            mean, posterior = posterior_of(prior, told)
        bank = bank.moved(mean)
        if in_doubt or trial.in_doubt:
            left = _seen_error(batch, bank) if in_doubt else (np.zeros(BATCH_STATES), posterior)
            inner = self.matcher.moved(inner, mean + left[0] - shown, left[1])
        return fix, Trial(inner, bank, posterior, in_doubt, aided, growth)


def _carried(batch: Batch, trial: Trial) -> tuple[ErrorHypotheses, Array | None, bool] | None:
    """Return the hypotheses at the end of a batch, before its fix; `Trial.growth` and
    `Trial.aided` as they are then. None where the batch does not know the attitude, or its numbers
    are of no navigator."""
    if batch.attitude is None:
        return None
    prior = joint_prior(batch)
    try:
        cholesky(prior)
        if trial.hypotheses is None or trial.posterior is None:
            return ErrorHypotheses.before(prior), None, trial.aided
        forward, growth, aided = _since(batch, trial.posterior, prior)
    except np.linalg.LinAlgError:
        return None
    more, believed = np.zeros_like(growth), growth
    if trial.in_doubt and trial.growth is not None:
        # a navigator that was made uncertain grows so for that reason, not by its sensors' errors
        scale, believed = np.sqrt(np.diag(prior)), trial.growth
        more = positive_part(growth - believed, scale)
        growth = positive_part(growth - more, scale)
    bank = trial.hypotheses.grown(forward, growth, more)
    # of one that is lost or was made uncertain the dynamics are not linear enough to tell an aid
    uncertain = trial.in_doubt or placeless(prior)
    return bank, believed, trial.aided or (aided and not uncertain)


def _since(batch: Batch, posterior: Array, prior: Array) -> tuple[Array, Array, bool]:
    """Return (7, 7) the navigator's error at a batch end per unit of that at the one before,
    (7, 7) what its covariance has grown by beside that, and whether something has aided it.

    Where it knows more than its dynamics explain, other sensors have aided it: its error E after
    them is (I - KH) times that before, and I - KH = P_after P_before^-1 (Groves 2013, eq. 3.60).
    """
    forward, growth, kept = with_aids(error_after(batch), np.ascontiguousarray(posterior), prior)
    if not np.isfinite(kept):
        raise np.linalg.LinAlgError("Singular matrix")
    return forward, growth, bool(kept < BATCH_STATES - CONSTANTS.aided_states)


@kernel
def with_aids(forward, posterior, prior):  # type: ignore[no-untyped-def]
    """Return both matrices of `_since`, and the trace of I - KH; `forward` is without aids."""
    n = prior.shape[0]
    scale, one = np.empty(n), np.ones(n)
    for i in range(n):
        scale[i] = math.sqrt(prior[i, i])
    before, after, step = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            before[i, j] = posterior[i, j] / (scale[i] * scale[j])
            after[i, j] = prior[i, j] / (scale[i] * scale[j])
            step[i, j] = forward[i, j] * scale[j] / scale[i]
    unaided = product(product(step, before), step.T)
    missing = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            missing[i, j] = after[i, j] - unaided[i, j]
    missing = positive(missing, one)
    for i in range(n):
        for j in range(n):
            unaided[i, j] += missing[i, j]
    kept = product(after, inverted(unaided))
    step = product(kept, step)
    left = product(product(step, before), step.T)
    for i in range(n):
        for j in range(n):
            left[i, j] = after[i, j] - left[i, j]
    growth = positive(left, one)
    trace = 0.0
    for i in range(n):
        trace += kept[i, i]
        for j in range(n):
            step[i, j] *= scale[i] / scale[j]
            growth[i, j] *= scale[i] * scale[j]
    return step, growth, trace


def _as_seen(batch: Batch, bank: ErrorHypotheses) -> tuple[Batch, Array]:
    """Return the batch as the hypotheses would have it, and (7,) the error that readings would
    show if they were right."""
    mean, _ = bank.believed()
    shown, wide = _seen_error(batch, bank)
    return seen_from(delayed(batch, float(mean[-1])), mean[:-1], wide), shown


def _seen_error(batch: Batch, bank: ErrorHypotheses) -> tuple[Array, Array]:
    """Return (7,) the error that readings would show if the hypotheses were right, and (7, 7) the
    covariance that batches are matched with while they lead."""
    mean, covariance = bank.believed()
    shown = with_delay(batch.velocity[-1])
    return shown @ mean, CONSTANTS.doubted_prior_factor * (shown @ covariance @ shown.T)


def _contradicted(batch: Batch, before: ErrorHypotheses, figures: Mapping[str, float]) -> Fix:
    """Return the fix that tells an aided navigator that it is not where it says: it no longer uses
    the aid and grows so uncertain that all that fixes have shown may be true. The fix itself was
    matched near the wrong place."""
    mean, covariance = (part[..., :-1] for part in before.believed())
    apart = covariance[:-1] + np.outer(mean, mean) - joint_prior(batch)
    own = np.sqrt(np.diag(joint_prior(batch)))
    widened = positive_part(apart, own) + CONTRADICTED_COVARIANCE
    reason = "fixes contradict the navigator, which no longer uses its velocity aid"
    return replace(declined(batch, reason, **figures), widened=widened)


def _told(batch: Batch, fix: Fix, mean: Array, covariance: Array, widening: Array) -> Fix:
    """Return the fix that makes the navigator believe that its error is N(mean, covariance), (7,)
    and (7, 7), once it has become less certain by a widening (7, 7)."""
    fix = replace(fix, reset=False, widened=widening)
    wide = joint_prior(batch) + widening
    if not fix.published:
        return fix
    error, _ = measurement_only(mean[:4], covariance[:4, :4], wide[:4, :4])
    north, east = metres_per_radian(batch.end[0])
    return replace(
        replaced(fix, mean, covariance, wide),
        latitude=float(batch.end[0] - error[0] / north),
        longitude=float(batch.end[1] - error[1] / east),
    )
