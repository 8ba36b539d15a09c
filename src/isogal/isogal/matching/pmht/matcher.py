"""`pmht`: probabilistic multi-hypothesis map matching with an exact batch likelihood.

The default matcher. It keeps the paper's idea, a batch of scans matched at once by probabilities
over many hypotheses under the kinematic constraint, and replaces what made it inexact
(docs/mathematics.md, section 13). A batch goes through six stages, each of which takes a `State`
and returns another:

    prepare            prior, noise model, bias and likelihood of the batch    prepare.py
    reject_outliers    by innovations, before the place is known               outliers.py
    update             posterior of the navigator's error, uneven map error,
                       outliers once the place is known                        update.py
    learn              the map error, from batches that agree with the map     learn.py
    assess             fix, ambiguous, biased, lost, or larger noise?          assess.py
    publish            information of the measurements alone; memory           publish.py

A stage that reaches a verdict ends the way of the batch; `publish` always comes last.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from isogal.arrays import Array
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.matching.monitoring import Insight
from isogal.matching.pmht.assess import assess
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.learn import learn
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.memory import Memory, VarianceFactor
from isogal.matching.pmht.noise_model import NoiseModel
from isogal.matching.pmht.outliers import reject_outliers
from isogal.matching.pmht.prepare import prepare, refusal, without
from isogal.matching.pmht.publish import publish
from isogal.matching.pmht.settings import Settings
from isogal.matching.pmht.state import State
from isogal.matching.pmht.update import update_state
from isogal.scenario import Matcher as MatcherSettings

STAGES = (reject_outliers, update_state, learn, assess)
"""Between `prepare` and `publish`."""


@dataclass(frozen=True)
class Pmht:
    """The default matcher. See the module; options in `settings.Options`."""

    settings: Settings
    name: str = "pmht"
    takes_channels: bool = True
    takes_parameters: ClassVar[bool] = True
    """Whether it estimates the parameters of a batch (`isogal.matching.parameters`)."""
    stride: ClassVar[int] = 5
    """New scans between fixes where nobody says otherwise: with fewer the result is the same, with
    more it waits longer for what the last readings say. Measured."""

    @classmethod
    def from_settings(cls, matcher: MatcherSettings) -> "Pmht":
        """Build it from a scenario's matcher section; raises InputError on a bad option."""
        return cls(Settings.of(matcher))

    @property
    def context(self) -> int:
        """Older scans that a batch brings along (`interfaces.Matcher`)."""
        return self.settings.context

    def match(
        self, batch: Batch, field_map: AnyMap, memory: Memory | None
    ) -> tuple[Fix, Memory | None]:
        """Match one batch; see `interfaces.Matcher`."""
        if reason := refusal(batch, field_map, self.settings):
            return declined(batch, reason), memory
        state = self._assessed(batch, field_map, memory)
        if state.verdict is not None and state.verdict.biased:
            biased = (memory or Memory.before(batch)).with_bias(state.verdict.bias)
            state = self._assessed(batch, field_map, biased)
        return publish(state)

    def _assessed(self, batch: Batch, field_map: AnyMap, memory: Memory | None) -> State:
        """Return the state of a batch with its verdict."""
        state = prepare(batch, field_map, memory, self.settings)
        for stage in STAGES:
            if state.verdict is None:
                state = stage(state)
        return state

    # What monitors ask (`monitoring.Monitored`).

    def insight(self, memory: Memory | None) -> Insight:
        """Say what the matcher has come to believe."""
        if memory is None:
            return Insight(0.0, None, None, None)
        error, untold = memory.map_error, self.settings.adaptive
        if error is None:
            return Insight(memory.log_evidence, None, None, memory.hypotheses)
        return Insight(
            memory.log_evidence,
            error.doubt,
            error.coarse_prior if untold else None,
            memory.hypotheses,
            told_doubt=-math.inf if untold else error.doubt,
            untold=untold,
        )

    def sceptic(
        self,
        batch: Batch,
        before: Memory | None,
        after: Memory,
        variance: float,
        confidence: float,
    ) -> tuple["Pmht", Memory]:
        """Return the matcher that takes the noise model learnt so far to the letter, with R times
        a factor, and asks a place for a probability; and its memory before a batch.
        """
        start = before or Memory.before(batch)
        options = self.settings.options.model_copy(update={"confidence": confidence, "trust": 1.0})
        settings = replace(
            self.settings, adaptive=False, noise=self._noise(after), options=options
        )
        factor = VarianceFactor.known(variance * start.variance_factor.value)
        return (
            replace(self, settings=settings),
            replace(start, map_error=None, variance_factor=factor),
        )

    def with_hypotheses(self, memory: Memory, of: Memory) -> Memory:
        """Return a memory with the hypotheses of another."""
        return replace(memory, hypotheses=of.hypotheses, taken=of.taken)

    def without_hypotheses(self, memory: Memory | None) -> Memory | None:
        """Return a memory that takes the navigator's own covariance for its prior."""
        return None if memory is None else replace(memory, hypotheses=None, taken=None)

    def carrying(self, memory: Memory, hypotheses: Mixture | None) -> Memory:
        """Return a memory with other hypotheses about the end of the last batch."""
        return replace(memory, hypotheses=hypotheses, taken=None)

    def given(
        self, memory: Memory | None, batch: Batch, hypotheses: Mixture | None
    ) -> Memory | None:
        """Return a memory with hypotheses about the end of a batch that is still to be matched."""
        if memory is None and hypotheses is None:
            return None
        return replace(
            memory or Memory.before(batch), hypotheses=None, current=hypotheses, taken=None
        )

    def after_others(self, memory: Memory, taken: Array, covariance: Array) -> Memory:
        """Return the memory of a navigator that has taken fixes of other fields as well."""
        return memory.after_others(taken, covariance)

    def likelihood(
        self, batch: Batch, field_map: AnyMap, memory: Memory, place: tuple[Array, Array]
    ) -> BatchLikelihood:
        """Return the likelihood of a batch by what is known after it, at a place: mean (4,) and
        covariance (4, 4) of xi.
        """
        used = without(batch, memory.outlier_times)
        likelihood = BatchLikelihood.of(used, field_map, self._noise(memory), place=place)
        return likelihood.scaled(memory.variance_factor.value)

    def _noise(self, memory: Memory) -> NoiseModel:
        told = self.settings.noise
        return told if memory.map_error is None else memory.map_error.model(told)
