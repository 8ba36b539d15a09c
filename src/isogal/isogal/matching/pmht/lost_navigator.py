"""Monitor of navigators that may be lost without knowing it: is the map worse than told, or is
the navigator somewhere else?

A navigator that is 10 km off and does not know it meets residuals like those of a poor map, only
larger and smoother: the matcher learns them as the map error, its fixes say next to nothing, and
no single batch tells the difference. Many batches together do. So when the evidence is against
the map error as told (`Insight.map_error_doubt`), a search begins: the same matcher is given the
batches of the last hour and those to come as a navigator would have them that took none of the
fixes since, whose covariance is that of a lost one at the start. Once the search is sure of a
place, the evidence of both for the same readings decides: either the navigator is told where it
is, or its place stands (docs/mathematics.md, section 8.7).
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap
from isogal.matching.batching import condition, unconditioned
from isogal.matching.information import likelihood_information, measurement_only
from isogal.matching.interfaces import LOST_COVARIANCE, Batch, Fix, Information
from isogal.matching.matrices import positive_part, symmetric
from isogal.matching.monitoring import Monitor
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.constants import CONSTANTS


@dataclass(frozen=True, slots=True, eq=False)
class _PastBatch:
    """A batch that the navigator has dealt with."""

    batch: Batch
    """Its new readings alone, or where a search is to match, all those since the last such batch
    as new ones and older ones."""
    field_map: AnyMap
    information: Information | None
    """What the navigator was told; None = nothing."""
    log_evidence: float
    """Of its new readings."""
    searched: bool
    """Whether a search is to match it."""
    new: int
    """How many of its readings no earlier batch had used."""

    @classmethod
    def of(
        cls, batch: Batch, field_map: AnyMap, fix: Fix, log_evidence: float, unsearched: int
    ) -> "_PastBatch":
        """Remember a batch; no search would have matched so many readings before it."""
        information = fix.information if fix.published else None
        count = unsearched + batch.new
        channels = 1 if batch.channel is None else int(batch.channel.max()) + 1
        enough = CONSTANTS.search_readings * channels
        searched = count >= enough or count + batch.new > len(batch)
        searched = searched or batch.backward is None
        kept = _with_new(batch, count) if searched else batch.part(len(batch) - batch.new)
        return cls(kept, field_map, information, log_evidence, searched, batch.new)

    @property
    def unsearched(self) -> int:
        """How many readings up to its end no search would have matched."""
        return 0 if self.searched else self.new

    @property
    def posterior(self) -> tuple[Array, Array]:
        """Mean (7,) and covariance (7, 7) of the navigator's error before the fix, given it."""
        return _posterior(joint_prior(self.batch), self.information)


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """A search for the navigator under way."""

    waiting: tuple[_PastBatch, ...]
    """Batches that it has not been given yet."""
    last: _PastBatch | None = None
    """Batch that it was given last."""
    covariance: Array | None = None
    """(7, 7) at the end of that, of the navigator that took no fixes."""
    shift: Array | None = None
    """(7,) the real navigator's estimate minus that one's, after the fix of that batch."""
    memory: Any = None
    """Of the matcher that searches."""
    log_evidence: float = 0.0
    """Of the batches it was given, by the matcher that does not doubt the navigator."""
    readings: int = 0
    """That it was given to match."""


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """What the monitor carries from batch to batch."""

    memory: Any = None
    """Of the matcher that it watches."""
    history: tuple[_PastBatch, ...] = ()
    search: _Search | None = None
    threshold: float = CONSTANTS.doubt_log_evidence
    """Doubt that starts the next search."""
    unsearched: int = 0
    """How many readings of the last batches no search would have matched."""


@dataclass(frozen=True)
class LostNavigatorMonitor(Monitor):
    """A matcher that finds a lost navigator. See the module."""

    def match(self, batch: Batch, field_map: AnyMap, memory: Watch | None) -> tuple[Fix, Watch]:
        """Match one batch; see `interfaces.Matcher`."""
        watch = memory or Watch()
        fix, after = self.matcher.match(batch, field_map, watch.memory)
        insight = self.matcher.insight(after)
        doubt = insight.map_error_doubt
        if batch.attitude is None or fix.reset or doubt is None:
            return fix, Watch(after, threshold=watch.threshold)
        gained = insight.log_evidence - self.matcher.insight(watch.memory).log_evidence
        past = _PastBatch.of(batch, field_map, fix, gained, watch.unsearched)
        unsearched = 0 if past.searched else watch.unsearched + batch.new
        history, search = _recent((*watch.history, past)), watch.search
        if search is not None:
            search = replace(search, waiting=(*search.waiting, past))
        elif doubt > watch.threshold:
            search = _Search(waiting=history)
        watch = Watch(after, history, search, watch.threshold, unsearched)
        return (fix, watch) if search is None else self._continue(search, fix, watch, doubt)

    def _continue(
        self, search: _Search, fix: Fix, watch: Watch, doubt: float
    ) -> tuple[Fix, Watch]:
        """Give a search its next batches, and act on what it finds."""
        current = watch.history[-1].batch
        figures = {**fix.diagnostics, "search_readings": float(search.readings)}
        fix = replace(fix, diagnostics=figures)
        threshold = max(CONSTANTS.renewed_doubt_factor * doubt, CONSTANTS.doubt_log_evidence)
        ended = replace(watch, search=None, threshold=threshold)
        matched = 0
        while search.waiting and matched < CONSTANTS.past_batches_at_once:
            search, found = self._next(search)
            if found is None:
                continue
            matched += 1
            if (
                found.reset
                or search.memory is None
                or search.readings > CONSTANTS.search_readings_at_most
                or self._confirms(search)
            ):
                return fix, ended
            if found.published and not search.waiting:
                ahead = self.matcher.insight(search.memory).log_evidence - search.log_evidence
                if ahead < CONSTANTS.moved_log_evidence:
                    return fix, ended
                return _reacquisition(found, current, search), Watch(search.memory)
        return fix, replace(watch, search=search)

    def _next(self, search: _Search) -> tuple[_Search, Fix | None]:
        """Match the next batch, if it is one of those to be matched, as the navigator would have
        it that has only taken the fixes of this search.
        """
        past, last = search.waiting[0], search.last
        prior = joint_prior(past.batch)
        if last is None or search.covariance is None or search.shift is None:
            covariance, shift = prior + LOST_COVARIANCE, np.zeros(BATCH_STATES)
        else:
            forward = np.linalg.inv(_back(past.batch))
            shift = forward @ search.shift
            grown = prior - forward @ last.posterior[1] @ forward.T
            grown = positive_part(grown, np.sqrt(np.diag(prior)))
            covariance = forward @ search.covariance @ forward.T + grown
        fix, memory, mean = None, search.memory, np.zeros(BATCH_STATES)
        if past.searched:
            seen = _seen_from(past.batch, shift, covariance)
            fix, memory = self.matcher.match(seen, past.field_map, search.memory)
            mean, covariance = _posterior(covariance, fix.information if fix.published else None)
        following = _Search(
            waiting=search.waiting[1:],
            last=past,
            covariance=covariance,
            shift=shift + mean - past.posterior[0],  # each fix takes its mean error away
            memory=memory,
            log_evidence=search.log_evidence + past.log_evidence,
            readings=search.readings + past.new,
        )
        return following, fix

    def _confirms(self, search: _Search) -> bool:
        """Whether the search comes to the navigator's own place by itself."""
        assert search.last is not None and search.shift is not None
        hypotheses = self.matcher.insight(search.memory).hypotheses
        if hypotheses is None:
            return False
        apart = np.hypot(*(hypotheses.mean[:, :2] + search.shift[:2]).T)
        sigma = math.sqrt(float(np.trace(search.last.posterior[1][:2, :2])))
        near = apart < CONSTANTS.same_place_m + CONSTANTS.same_place_sigma * sigma
        return float(hypotheses.weight[near].sum()) > CONSTANTS.same_place_probability


def _recent(history: tuple[_PastBatch, ...]) -> tuple[_PastBatch, ...]:
    """Return the last batches: whole stretches that a search would match, of so many readings at
    most."""
    count, first = 0, len(history)
    for k in range(len(history) - 1, -1, -1):
        count += history[k].new
        if count > CONSTANTS.remembered_readings:
            break
        if k == 0 or history[k - 1].searched:
            first = k
    return history[first:]


def _with_new(batch: Batch, new: int) -> Batch:
    """Return the batch with so many of its last readings new."""
    channels = 1 if batch.channel is None else int(batch.channel.max()) + 1
    new = min(new, len(batch))
    before = len(batch) - new - 1
    if batch.backward is None or before < 0 or new == batch.new:
        return (
            batch
            if new == batch.new
            else replace(batch, new=new, back_transition=None, back_nuisance=None)
        )
    back, nuisance = condition(
        batch.backward[None, before // channels * channels], joint_prior(batch)
    )
    return replace(batch, new=new, back_transition=back[0], back_nuisance=nuisance[0])


def _reacquisition(found: Fix, batch: Batch, search: _Search) -> Fix:
    """Return the fix that tells the navigator where it is."""
    assert search.last is not None and search.covariance is not None and search.shift is not None
    # the batch's own fix is not taken
    mean, covariance = search.shift + search.last.posterior[0], search.covariance
    lost = joint_prior(batch) + LOST_COVARIANCE
    return replace(
        found,
        covariance=measurement_only(mean[:4], covariance[:4, :4], lost[:4, :4])[1],
        information=likelihood_information(mean, covariance, lost),
        diagnostics={**found.diagnostics, "navigator_lost": 1.0},
        reset=True,
        scan_position=None,  # of scans that the navigator saw elsewhere
        scan_covariance=None,
        scan_information=None,
    )


def _seen_from(batch: Batch, shift: Array, covariance: Array) -> Batch:
    """Return the batch as another navigator would have it.

    Parameters
    ----------
    batch : Batch
        With attitude.
    shift : (7,) array
        Estimate of the batch's navigator minus that of the other one, at the batch end.
    covariance : (7, 7) array
        Of the other one's error there.
    """
    batch = batch.part(max(0, len(batch) - batch.new - CONSTANTS.search_context_readings))
    position = unconditioned(batch, batch.transition, batch.nuisance_position)
    reading = unconditioned(batch, batch.reading_jacobian, batch.nuisance_reading)
    moved = position @ shift
    north, east = metres_per_radian(batch.latitude)
    rows = np.concatenate([position, reading[:, None]], axis=1)
    by_xi, nuisance = condition(rows, covariance)
    back, back_nuisance = condition(_back(batch)[None], covariance)
    level, level_nuisance = condition(np.eye(BATCH_STATES)[None, 4:], covariance)
    end = batch.end
    to_north, to_east = metres_per_radian(end[0])
    return replace(
        batch,
        end_place=(end[0] - float(shift[0] / to_north), end[1] - float(shift[1] / to_east)),
        latitude=batch.latitude - moved[:, 0] / north,
        longitude=batch.longitude - moved[:, 1] / east,
        reading=batch.reading - reading @ shift,
        transition=np.ascontiguousarray(by_xi[:, :2]),
        reading_jacobian=np.ascontiguousarray(by_xi[:, 2]),
        nuisance_position=np.ascontiguousarray(nuisance[:, :2]),
        nuisance_reading=np.ascontiguousarray(nuisance[:, 2]),
        prior=covariance[:4, :4],
        back_transition=None if batch.back_transition is None else back[0],
        back_nuisance=None if batch.back_nuisance is None else back_nuisance[0],
        attitude=(level[0], level_nuisance[0]),
    )


def _back(batch: Batch) -> Array:
    """Return (7, 7) the error at the end of the batch before per unit of error at this one's; a
    first batch has none.
    """
    if batch.back_transition is None or batch.back_nuisance is None:
        return np.eye(BATCH_STATES)
    return unconditioned(batch, batch.back_transition, batch.back_nuisance)


def _posterior(prior: Array, information: Information | None) -> tuple[Array, Array]:
    """Return mean (7,) and covariance (7, 7) of the error N(0, prior) given the information."""
    if information is None:
        return np.zeros(BATCH_STATES), prior
    covariance = np.linalg.inv(np.linalg.inv(prior) + information.matrix)
    return covariance @ information.vector, symmetric(covariance)
