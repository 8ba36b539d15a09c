"""What watches a matcher from outside, and what it may ask of it.

A monitor wraps a matcher and is a matcher itself (`interfaces.Matcher`): it passes batches on,
and acts on what the matcher has come to believe. Two are there: for a navigator that may be lost
(`pmht.lost_navigator`) and for recorded tracks (`pmht.robust`). They work with any matcher that
follows the protocol `Monitored`.
"""

import math
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

from isogal.arrays import Array
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import Batch, Fix, Matcher
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.map_error import MapErrorPrior


@dataclass(frozen=True, slots=True, eq=False)
class Insight:
    """What a matcher has come to believe."""

    log_evidence: float
    """Log probability density of all readings so far, each batch given the ones before."""
    map_error_doubt: float | None
    """Log Bayes factor of a map error above what was told against one that is not; of several
    fields the largest. None = it is not in question."""
    map_error_prior: MapErrorPrior | None
    """What was believed of the map's error before any reading; None = somebody has told it."""
    hypotheses: Mixture | None
    """About the navigator's error at the end of the last batch; None = the navigator's own
    prior."""
    told_doubt: float = -math.inf
    """The largest such factor of fields whose map error somebody has told."""
    untold: bool = False
    """Whether there are fields of whose map error nobody has told anything."""


@runtime_checkable
class Monitored(Protocol):
    """A matcher that can be watched. `memory` is what `match` returned."""

    @property
    def name(self) -> str:
        """As scenarios name it."""
        ...

    @property
    def context(self) -> int:
        """See `interfaces.Matcher`."""
        ...

    @property
    def takes_channels(self) -> bool:
        """See `interfaces.Matcher`."""
        ...

    def match(self, batch: Batch, field_map: AnyMap, memory: Any) -> tuple[Fix, Any]:
        """See `interfaces.Matcher`."""
        ...

    def insight(self, memory: Any) -> Insight:
        """Say what the matcher has come to believe."""
        ...

    def sceptic(
        self, batch: Batch, before: Any, after: Any, variance: float, confidence: float
    ) -> tuple[Self, Any]:
        """Return the matcher that takes the noise model known after a batch to the letter, with
        R times a variance, and asks a place for a probability; and its memory before the batch.
        """
        ...

    def with_hypotheses(self, memory: Any, of: Any) -> Any:
        """Return a memory with the hypotheses of another."""
        ...

    def without_hypotheses(self, memory: Any) -> Any:
        """Return a memory that takes the navigator's own covariance for its prior."""
        ...

    def likelihood(
        self, batch: Batch, field_map: AnyMap, memory: Any, place: tuple[Array, Array]
    ) -> BatchLikelihood:
        """Return the likelihood of a batch by what is known after it, at a place: mean (4,) and
        covariance (4, 4) of xi.
        """
        ...


@dataclass(frozen=True)
class Monitor:
    """What every monitor says of itself: the same as the matcher that it watches."""

    matcher: Matcher

    @property
    def name(self) -> str:
        """Of the matcher that it watches."""
        return self.matcher.name

    @property
    def context(self) -> int:
        """Older scans that a batch brings along."""
        return self.matcher.context

    @property
    def takes_channels(self) -> bool:
        """As the matcher that it watches."""
        return self.matcher.takes_channels
