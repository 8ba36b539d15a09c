"""A second opinion for `pmht`: where the map seems to be worse than was said, is it the map, or is
the navigator somewhere else?

A navigator that is 10 km off and does not know it meets residuals that look like those of a poor
map, only larger and smoother: the matcher learns them as the map's error (`noise_estimation`), its
fixes say next to nothing, and no single batch tells the difference. Many batches together do. So
when the evidence is against the map's error as told (`NoiseEstimate.doubt`), a second matcher is
asked that takes the map's error as told and the navigator as lost. It is given the batches of the
last hour and those to come, as a navigator would have that took none of the fixes since, with the
covariance that it would have had, started with LOST_SIGMA more. Once it is sure of a place, the
two matchers' evidence for the same readings decides: either the navigator is told where it is, or
its place stands."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.matching.batching import condition, unconditioned
from isogal.matching.information import (
    joint_prior,
    likelihood_information,
    measurement_only,
    positive_part,
)
from isogal.matching.interfaces import LOST_COVARIANCE, Batch, Fix, Information
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.memory import Memory
from isogal.scenario import Matcher as MatcherSettings

_DOUBTED = 4.0
"""Log Bayes factor against the map's error as told that asks for a second opinion; that of right
navigators stayed below 2.5."""
_AGAIN = 10.0
"""Factor by which it must have grown for the next, after an opinion that the navigator's place
stands."""
_BETTER = 8.0
"""Log evidence by which the other place must be ahead."""
_SAME = 0.95
"""Probability that the second matcher gives the navigator's own place before it is heard no
longer."""
_NEAR = 500.0
"""m, on top of three of its 1-sigmas: within this of the navigator is its own place."""
_HISTORY = 12
"""Batches remembered."""
_AT_ONCE = 2
"""Batches of the past that are matched along with a new one: the search is wide, and the new fix
must not wait for long."""
_CONTEXT = 10
"""Older scans that the second matcher sees of a batch."""
_PATIENCE = 36
"""Batches after which a second matcher that is still not sure is given up."""


@dataclass(frozen=True, slots=True, eq=False)
class _Past:
    """A batch that has been matched."""

    batch: Batch
    information: Information | None
    """What the navigator was told; None = nothing."""
    evidence: float
    """Log density of its readings."""

    @property
    def posterior(self) -> tuple[Array, Array]:
        """Mean (7,) and covariance (7, 7) of the navigator's error, as seen before the fix, once
        it was told."""
        return _posterior(joint_prior(self.batch), self.information)


@dataclass(frozen=True, slots=True, eq=False)
class _Opinion:
    """The second matcher's state."""

    waiting: tuple[_Past, ...]
    """Batches that it has not been given yet."""
    last: _Past | None = None
    """Batch that it was given last."""
    covariance: Array | None = None
    """(7, 7) at the end of that, of the navigator that took no fixes."""
    shift: Array | None = None
    """(7,) the navigator's estimate minus that one's, after the fix of that batch."""
    memory: Memory | None = None
    evidence: float = 0.0
    """First matcher's log evidence of the batches it was given."""
    batches: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Doubts:
    """What `Doubting` carries from batch to batch."""

    memory: Memory | None
    """First matcher's."""
    history: tuple[_Past, ...] = ()
    opinion: _Opinion | None = None
    threshold: float = _DOUBTED
    """Doubt that asks for the next opinion."""


@dataclass(frozen=True)
class Doubting:
    """`pmht` as scenarios have it: the matcher of batches with a second opinion. See the
    module."""

    first: Pmht
    name: str = "pmht"
    takes_channels: ClassVar[bool] = True

    @classmethod
    def from_settings(cls, matcher: MatcherSettings) -> "Doubting":
        """Build it from a scenario's matcher section; raises InputError on an unknown or bad
        option."""
        return cls(Pmht.from_settings(matcher))

    @property
    def context(self) -> int:
        """Scans before the batch."""
        return self.first.context

    def match(
        self, batch: Batch, field_map: FieldMap | ChannelMap, memory: Doubts | None
    ) -> tuple[Fix, Doubts]:
        """Match one batch; see `interfaces.Matcher`."""
        doubts = memory or Doubts(None)
        fix, after = self.first.match(batch, field_map, doubts.memory)
        doubt = after.noise.doubt if after is not None and after.noise is not None else 0.0
        if (
            batch.attitude is None
            or fix.reset
            or after is None
            or after.noise is None
            or after.noise.prior is None
        ):
            return fix, Doubts(after, threshold=doubts.threshold)
        before = doubts.memory.evidence if doubts.memory else 0.0
        past = _Past(batch, fix.information if fix.published else None, after.evidence - before)
        history, opinion = (*doubts.history, past)[-_HISTORY:], doubts.opinion
        if opinion is not None:
            opinion = replace(opinion, waiting=(*opinion.waiting, past))
        elif doubt > doubts.threshold:
            opinion = _Opinion(waiting=history)
        doubts = Doubts(after, history, opinion, doubts.threshold)
        if opinion is None:
            return fix, doubts
        return self._ask(opinion, batch, field_map, fix, doubts, doubt)

    def _ask(
        self,
        opinion: _Opinion,
        batch: Batch,
        field_map: FieldMap | ChannelMap,
        fix: Fix,
        doubts: Doubts,
        doubt: float,
    ) -> tuple[Fix, Doubts]:
        """Give the second matcher its next batches, and do what it says."""
        fix = replace(
            fix, diagnostics={**fix.diagnostics, "second_opinion": float(opinion.batches)}
        )
        settled = replace(doubts, opinion=None, threshold=max(_AGAIN * doubt, _DOUBTED))
        for _ in range(1 + _AT_ONCE):
            if not opinion.waiting:
                break
            opinion, elsewhere = self._next(opinion, field_map)
            if (
                elsewhere.reset
                or opinion.memory is None
                or opinion.batches > _PATIENCE
                or _stands(opinion)
            ):
                return fix, settled
            if elsewhere.published and not opinion.waiting:
                if opinion.memory.evidence - opinion.evidence < _BETTER:
                    return fix, settled
                return _moved(elsewhere, batch, opinion), Doubts(opinion.memory)
        return fix, replace(doubts, opinion=opinion)

    def _next(self, opinion: _Opinion, field_map: FieldMap | ChannelMap) -> tuple[_Opinion, Fix]:
        """Match the next batch as the navigator would have it that has only taken this matcher's
        fixes."""
        past, last = opinion.waiting[0], opinion.last
        prior = joint_prior(past.batch)
        if last is None or opinion.covariance is None or opinion.shift is None:
            covariance, shift = prior + LOST_COVARIANCE, np.zeros(7)
        else:
            forward = np.linalg.inv(_back(past.batch))
            shift = forward @ opinion.shift
            grown = prior - forward @ last.posterior[1] @ forward.T
            covariance = forward @ opinion.covariance @ forward.T + positive_part(
                grown, np.sqrt(np.diag(prior))
            )
        seen = _seen_by(past.batch, shift, covariance)
        fix, memory = self.first.match(seen, field_map, opinion.memory)
        mean, covariance = _posterior(covariance, fix.information if fix.published else None)
        following = _Opinion(
            waiting=opinion.waiting[1:],
            last=past,
            covariance=covariance,
            shift=shift + mean - past.posterior[0],  # each fix takes its mean error away
            memory=memory,
            evidence=opinion.evidence + past.evidence,
            batches=opinion.batches + 1,
        )
        return following, fix


def _stands(opinion: _Opinion) -> bool:
    """Whether the second matcher comes to the navigator's own place by itself."""
    assert opinion.last is not None and opinion.shift is not None and opinion.memory is not None
    belief = opinion.memory.belief
    if belief is None:
        return False
    apart = np.hypot(*(belief.mean[:, :2] + opinion.shift[:2]).T)
    near = apart < _NEAR + 3.0 * math.sqrt(float(np.trace(opinion.last.posterior[1][:2, :2])))
    return float(belief.weight[near].sum()) > _SAME


def _moved(elsewhere: Fix, batch: Batch, opinion: _Opinion) -> Fix:
    """Return the fix that tells the navigator where it is."""
    assert (
        opinion.last is not None and opinion.covariance is not None and opinion.shift is not None
    )
    mean, covariance = (
        opinion.shift + opinion.last.posterior[0],
        opinion.covariance,
    )  # the batch's own fix is not taken
    lost = joint_prior(batch) + LOST_COVARIANCE
    return replace(
        elsewhere,
        covariance=measurement_only(mean[:4], covariance[:4, :4], lost[:4, :4])[1],
        information=likelihood_information(mean, covariance, lost),
        diagnostics={**elsewhere.diagnostics, "navigator_lost": 1.0},
        reset=True,
        scan_position=None,  # of scans that the navigator saw elsewhere
        scan_covariance=None,
    )


def _seen_by(batch: Batch, shift: Array, covariance: Array) -> Batch:
    """Return the batch as a navigator would have it that stands elsewhere and knows its error
    otherwise.

    Parameters
    ----------
    shift : (7,) array
        Estimate of the batch's navigator minus that one's, at the batch end.
    covariance : (7, 7) array
        Of that one's error there.
    """
    batch = _shortened(batch)
    position = unconditioned(batch, batch.transition, batch.nuisance_position)
    reading = unconditioned(batch, batch.reading_jacobian, batch.nuisance_reading)
    moved = position @ shift
    north, east = metres_per_radian(batch.latitude)
    rows = np.concatenate([position, reading[:, None]], axis=1)
    by_xi, drift = condition(rows, covariance)
    back, back_nuisance = condition(_back(batch)[None], covariance)
    level, level_drift = condition(np.eye(7)[None, 4:], covariance)
    return replace(
        batch,
        latitude=batch.latitude - moved[:, 0] / north,
        longitude=batch.longitude - moved[:, 1] / east,
        reading=batch.reading - reading @ shift,
        transition=np.ascontiguousarray(by_xi[:, :2]),
        reading_jacobian=np.ascontiguousarray(by_xi[:, 2]),
        nuisance_position=np.ascontiguousarray(drift[:, :2]),
        nuisance_reading=np.ascontiguousarray(drift[:, 2]),
        prior=covariance[:4, :4],
        back_transition=None if batch.back_transition is None else back[0],
        back_nuisance=None if batch.back_nuisance is None else back_nuisance[0],
        attitude=(level[0], level_drift[0]),
    )


def _back(batch: Batch) -> Array:
    """Return (7, 7) the error at the end of the batch before per unit of error at this one's; a
    first batch has none."""
    if batch.back_transition is None or batch.back_nuisance is None:
        return np.eye(7)
    return unconditioned(batch, batch.back_transition, batch.back_nuisance)


def _shortened(batch: Batch) -> Batch:
    """Return the batch with only the last of its older scans: they tell most about the map's
    error, and the search takes less long."""
    rows = slice(max(0, len(batch) - batch.new - _CONTEXT), None)
    names = (
        "time", "latitude", "longitude", "velocity", "reading", "sigma", "offset",
        "transition", "reading_jacobian", "nuisance_position", "nuisance_reading",
    )  # fmt: skip
    return replace(batch, **{name: getattr(batch, name)[rows] for name in names})


def _posterior(prior: Array, information: Information | None) -> tuple[Array, Array]:
    """Return mean (7,) and covariance (7, 7) of the error N(0, prior) given the information."""
    if information is None:
        return np.zeros(7), prior
    covariance = np.linalg.inv(np.linalg.inv(prior) + information.matrix)
    return covariance @ information.vector, 0.5 * (covariance + covariance.T)
