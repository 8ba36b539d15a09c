"""Monitor of what the navigator and the matcher have been told: is the navigator worse than it
says, are fixes worse than they say, are the readings late?

Beside the navigator runs a bank of hypotheses (`error_hypotheses`). While the assumptions as they
are foretell the fixes best, nothing is changed. Once another hypothesis is clearly ahead it leads:
batches are matched as its navigator would have them, and the real navigator is told what it
believes, mean and covariance (docs/mathematics.md, section 8.8).
"""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap
from isogal.matching.information import measurement_only, replaced
from isogal.matching.interfaces import LOST_COVARIANCE, Batch, Fix, Information, Matcher
from isogal.matching.matrices import positive_part
from isogal.matching.monitoring import Monitor
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.delay import by_delay, later
from isogal.matching.pmht.error_hypotheses import ErrorHypotheses, with_delay
from isogal.matching.pmht.past_batches import error_before, posterior_of, seen_from


class Forgetful(Matcher, Protocol):
    """A matcher that can be told that the navigator is another one than it believes."""

    def without_hypotheses(self, memory: Any) -> Any:
        """Return a memory that takes the navigator's own covariance for its prior."""
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


@dataclass(frozen=True)
class AssumptionsMonitor(Monitor):
    """A matcher that finds out what it should have been told. See the module."""

    matcher: Forgetful

    def match(self, batch: Batch, field_map: AnyMap, memory: Trial | None) -> tuple[Fix, Trial]:
        """Match one batch; see `interfaces.Matcher`."""
        trial = memory or Trial()
        bank = _carried(batch, trial)
        if bank is None:
            fix, inner = self.matcher.match(batch, field_map, trial.memory)
            return fix, Trial(inner)
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
            widening = positive_part(before.believed()[1][:-1, :-1] - own, np.sqrt(np.diag(own)))
            fix = _told(batch, fix, mean, posterior, widening)
        else:
            mean, posterior = posterior_of(prior, told)
        return fix, Trial(inner, bank.moved(mean), posterior, in_doubt)


def _carried(batch: Batch, trial: Trial) -> ErrorHypotheses | None:
    """Return the hypotheses at the end of a batch, before its fix; None where the batch does not
    know the attitude, or its numbers are of no navigator."""
    if batch.attitude is None:
        return None
    prior = joint_prior(batch)
    try:
        np.linalg.cholesky(prior)
        if trial.hypotheses is None or trial.posterior is None:
            return ErrorHypotheses.before(prior)
        forward = np.asarray(np.linalg.inv(error_before(batch)), dtype=np.float64)
        growth = prior - forward @ trial.posterior @ forward.T
        growth = positive_part(growth, np.sqrt(np.diag(prior)))
    except np.linalg.LinAlgError:
        return None
    return trial.hypotheses.grown(forward, growth)


def _as_seen(batch: Batch, bank: ErrorHypotheses) -> tuple[Batch, Array]:
    """Return the batch as the hypotheses would have it, and (7,) the error that readings would
    show if they were right."""
    mean, covariance = bank.believed()
    delay = float(mean[-1])
    moved = replace(later(batch, delay), offset=batch.offset - delay * by_delay(batch))
    shown = with_delay(batch.velocity[-1])
    wide = CONSTANTS.doubted_prior_factor * (shown @ covariance @ shown.T)
    return seen_from(moved, mean[:-1], wide), shown @ mean


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
