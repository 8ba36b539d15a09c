"""Monitor of navigators that may be lost without knowing it: is the map worse than told, or is
the navigator somewhere else?

A navigator that is 10 km off and does not know it meets residuals like those of a poor map, only
larger and smoother: the matcher learns them as the map error, its fixes say next to nothing, and
no single batch tells the difference. Many batches together do. So when the evidence is against
the map error as told (`Insight.map_error_doubt`), or where nothing is told, when a look at the
whole neighbourhood finds a place that fits far better (`elsewhere`), a search begins: the same
matcher is given the batches of the last hour and those to come as a navigator would have them
that took none of the fixes since, whose covariance is that of a lost one at the start. Once the
search is sure of a place, the evidence of both for the same readings decides: either the
navigator is told where it is, or its place stands, or the search goes on (docs/mathematics.md,
section 8.7).
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap
from isogal.matching.information import replaced
from isogal.matching.interfaces import LOST_COVARIANCE, Batch, Fix
from isogal.matching.monitoring import Insight, Monitor, Monitored
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.elsewhere import Look, look_elsewhere
from isogal.matching.pmht.other_fields import hour_of, log_evidence_of_others
from isogal.matching.pmht.past_batches import (
    PastBatch,
    placeless,
    posterior_of,
    recent,
    seen_from,
)
from isogal.matrices import positive_part, symmetric


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """A search for the navigator under way."""

    waiting: tuple[PastBatch, ...]
    """Batches that it has not been given yet."""
    last: PastBatch | None = None
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
    look: Look | None = None
    """Where it began; None = everywhere."""

    def start(self, prior: Array) -> tuple[Array, Array]:
        """Return mean (7,) and covariance (7, 7) of how wrong the navigator may be at the start,
        by what it says of itself (7, 7): if it is lost anywhere, or where the look says, with
        what its place says of the rest of its error."""
        wide = prior + LOST_COVARIANCE
        if self.look is None:
            return np.zeros(BATCH_STATES), wide
        gain = np.linalg.solve(wide[:2, :2], wide[:2]).T
        covariance = wide - gain @ wide[:2] + gain @ self.look.covariance @ gain.T
        return gain @ self.look.place, symmetric(covariance)

    def covers(self, look: Look) -> bool:
        """Whether it began where a look says that the navigator is."""
        if self.look is None:
            return True
        apart = float(np.hypot(*(look.place - self.look.place)))
        return apart < CONSTANTS.look_one_place_m


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """What the monitor carries from batch to batch."""

    memory: Any = None
    """Of the matcher that it watches."""
    history: tuple[PastBatch, ...] = ()
    search: _Search | None = None
    threshold: float = CONSTANTS.doubt_log_evidence
    """Doubt that starts the next search."""
    seen: int = 0
    """Readings since the navigator's place was known."""
    look_at: int = CONSTANTS.first_look_readings
    """How many of them there are at the next look elsewhere."""


@dataclass(frozen=True)
class LostNavigatorMonitor(Monitor):
    """A matcher that finds a lost navigator. See the module."""

    matcher: Monitored

    def match(self, batch: Batch, field_map: AnyMap, memory: Watch | None) -> tuple[Fix, Watch]:
        """Match one batch; see `interfaces.Matcher`."""
        watch = memory or Watch()
        fix, after = self.matcher.match(batch, field_map, watch.memory)
        insight = self.matcher.insight(after)
        found = fix.published and placeless(batch.prior)
        unasked = insight.map_error_doubt is None
        if batch.attitude is None or fix.reset or unasked or found:
            return fix, Watch(after, threshold=watch.threshold)
        gained = insight.log_evidence - self.matcher.insight(watch.memory).log_evidence
        past = PastBatch.of(batch, field_map, fix, gained, watch.history)
        history, search = recent((*watch.history, past)), watch.search
        seen, look_at = watch.seen + batch.new, watch.look_at
        doubt = _counting(insight, batch)
        if search is not None:
            search = replace(search, waiting=(*search.waiting, past))
        elif doubt > watch.threshold:
            search = _Search(waiting=history)
        if seen >= look_at:
            look = self._look(history, after)
            look_at = seen + (look.readings_to_next if look else CONSTANTS.look_every_readings)
            search = _looked(search, history, look)
        watch = Watch(after, history, search, watch.threshold, seen, look_at)
        return (fix, watch) if search is None else self._continue(search, fix, watch, doubt)

    def without_hypotheses(self, memory: Watch | None) -> Watch | None:
        """Return a memory whose matcher takes the navigator's own covariance for its prior."""
        if memory is None:
            return None
        return replace(memory, memory=self.matcher.without_hypotheses(memory.memory))

    def moved(self, memory: Watch | None, by: Array, covariance: Array) -> Watch | None:
        """Return the memory after a batch whose fix the navigator has not taken as it was: its
        estimate has lost an error (7,) and its covariance is (7, 7)."""
        if memory is None or not memory.history:
            return memory
        *before, last = memory.history
        taken, search = replace(last, posterior=(by, covariance)), memory.search
        if search is not None and search.waiting:
            search = replace(search, waiting=(*search.waiting[:-1], taken))
        elif search is not None and search.shift is not None:
            shift = search.shift + last.posterior[0] - by
            search = replace(search, last=taken, shift=shift)
        return replace(memory, history=(*before, taken), search=search)

    def _look(self, history: tuple[PastBatch, ...], memory: Any) -> Look | None:
        insight = self.matcher.insight(memory)
        if not insight.untold:
            return None
        hour = hour_of(self.matcher, memory, history, insight.map_error_prior)
        return None if hour is None else look_elsewhere(hour)

    def _continue(
        self, search: _Search, fix: Fix, watch: Watch, doubt: float
    ) -> tuple[Fix, Watch]:
        """Give a search its next batches, and act on what it finds."""
        current = watch.history[-1].batch
        figures = {**fix.diagnostics, "search_readings": float(search.readings)}
        fix = replace(fix, diagnostics=figures)
        threshold = max(CONSTANTS.renewed_doubt_factor * doubt, CONSTANTS.doubt_log_evidence)
        ended = replace(watch, search=None, threshold=threshold)
        channels = current.rows_per_scan  # so many times as long each batch takes, too
        matched, most = 0, max(1, CONSTANTS.past_batches_at_once // channels)
        if channels > 1 and len(watch.history) == 1:
            most = 0  # none of whose readings has been matched before: it takes long by itself
        while search.waiting and matched < most:
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
                stands = self._stands(search, watch)
                if (
                    stands
                    and self._others(search, watch) >= -CONSTANTS.others_against_log_evidence
                ):
                    return _reacquisition(found, current, search), Watch(search.memory)
                if stands is not None:
                    return fix, ended
        return fix, replace(watch, search=search)

    def _stands(self, search: _Search, watch: Watch) -> bool | None:
        """Return whether the place found stands, or the navigator's own (False); None where that
        is open.

        Their evidence for the same readings decides: by a look where one began the search, since
        each of the two matchers has learnt a noise model, which one batch may have misled. Of a
        navigator that knows that it is lost it is the place against all others."""
        if search.look is None:
            ahead = self.matcher.insight(search.memory).log_evidence - search.log_evidence
        else:
            look = self._look(watch.history, watch.memory)
            if look is None or not search.covers(look):
                return None
            if placeless(watch.history[-1].batch.prior):
                return True if look.probability > CONSTANTS.found_probability else None
            ahead = look.log_evidence
        if abs(ahead) < CONSTANTS.moved_log_evidence:
            return None
        return ahead > 0.0

    def _others(self, search: _Search, watch: Watch) -> float:
        """Return the log evidence of the place found by the readings of other fields."""
        assert search.last is not None and search.covariance is not None
        assert search.shift is not None
        place = search.shift + search.last.posterior[0], search.covariance
        return log_evidence_of_others(self.matcher, watch.memory, watch.history, place)

    def _next(self, search: _Search) -> tuple[_Search, Fix | None]:
        """Match the next batch, if it is one of those to be matched, as the navigator would have
        it that has only taken the fixes of this search.
        """
        past, last = search.waiting[0], search.last
        prior = joint_prior(past.batch)
        if last is None or search.covariance is None or search.shift is None:
            shift, covariance = search.start(prior)
        else:
            forward = past.forward
            shift = forward @ search.shift
            grown = prior - forward @ last.posterior[1] @ forward.T
            grown = positive_part(grown, np.sqrt(np.diag(prior)))
            covariance = forward @ search.covariance @ forward.T + grown
        fix, memory, mean = None, search.memory, np.zeros(BATCH_STATES)
        if past.searched:
            seen = seen_from(_shortened(past.batch), shift, covariance)
            fix, memory = self.matcher.match(seen, past.field_map, search.memory)
            mean, covariance = posterior_of(covariance, fix.information if fix.published else None)
        following = replace(
            search,
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
        if search.look is not None and search.waiting:
            return False  # a look says that it is elsewhere now: it may have been right then
        hypotheses = self.matcher.insight(search.memory).hypotheses
        if hypotheses is None or placeless(search.last.posterior[1]):
            return False
        apart = np.hypot(*(hypotheses.mean[:, :2] + search.shift[:2]).T)
        sigma = math.sqrt(float(np.trace(search.last.posterior[1][:2, :2])))
        limit = CONSTANTS.same_place_m + CONSTANTS.same_place_sigma * sigma
        if search.look is not None:  # a place that looks tell apart from its own, however vague
            limit = min(limit, CONSTANTS.look_one_place_m)
        near = apart < limit
        return float(hypotheses.weight[near].sum()) > CONSTANTS.same_place_probability


def _counting(insight: Insight, batch: Batch) -> float:
    """Return the doubt that starts a search: that of any field whose map error was told. Where
    nobody has told it, few readings doubt it by chance, and a poor map then fits better somewhere
    else: looks find a lost navigator there, but not by several channels."""
    if insight.untold and batch.channel is None:
        return insight.told_doubt
    return -math.inf if insight.map_error_doubt is None else insight.map_error_doubt


def _looked(
    search: _Search | None, history: tuple[PastBatch, ...], look: Look | None
) -> _Search | None:
    """Return the search after a look at the last hour's readings: one where the look says that
    the navigator is, unless it is under way there."""
    if look is None or not look.says_lost or (search is not None and search.covers(look)):
        return search
    return _Search(waiting=history, look=look)


def _shortened(batch: Batch) -> Batch:
    """Return a batch with as many of its older readings as a search sees."""
    beside = tuple(replace(one, batch=_shortened(one.batch)) for one in batch.beside)
    first = max(0, len(batch) - batch.new - CONSTANTS.search_context_readings)
    return replace(batch.part(first), beside=beside)


def _reacquisition(found: Fix, batch: Batch, search: _Search) -> Fix:
    """Return the fix that tells the navigator where it is."""
    assert search.last is not None and search.covariance is not None and search.shift is not None
    # the batch's own fix is not taken
    mean, covariance = search.shift + search.last.posterior[0], search.covariance
    lost = joint_prior(batch) + LOST_COVARIANCE
    return replace(
        replaced(found, mean, covariance, lost),
        diagnostics={**found.diagnostics, "navigator_lost": 1.0},
        reset=True,
    )
