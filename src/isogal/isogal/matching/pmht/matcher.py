"""`pmht`: probabilistic multi-hypothesis map matching by one bank of hypotheses.

The default matcher. It keeps the paper's idea, readings matched by probabilities over many
hypotheses under the kinematic constraint. A hypothesis is a model of what is not known (how wrong
the map is, how noisy or biased the instrument, whether the navigator is worse than it says) and a
Gaussian about the navigator's error, the map's error under the vehicle and the instrument's
states. Every reading is a Kalman update of every hypothesis; how well each foretold it is its
evidence (docs/mathematics.md, sections 4 to 9).

    propagate    hypotheses follow the navigator to the batch end      memory.py
    observe      they take the new readings, field by field            hypotheses.py, rows.py
    search       is the navigator somewhere else?                      search.py, cells.py
    publish      what the readings alone say; what is remembered       publish.py
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from isogal.arrays import Array
from isogal.maps.channels import AnyMap, channels_of
from isogal.matching.interfaces import (
    LOST_COVARIANCE,
    Batch,
    Fix,
    Information,
    SecondaryBatch,
    declined,
)
from isogal.matching.pmht.cells import FEATURE_M, longest
from isogal.matching.pmht.hypotheses import Hypotheses, with_needed
from isogal.matching.pmht.memory import Memory, decided, undeceived
from isogal.matching.pmht.models import RARE, assumed, models_of, options_of
from isogal.matching.pmht.publish import added, published, total
from isogal.matching.pmht.rows import Rows, parts_of, rows_of
from isogal.matching.pmht.search import (
    LIKELY,
    WIDE_M,
    Diverged,
    FieldMemory,
    probability_at,
    pursued,
    resolved,
)
from isogal.matching.pmht.states import States, displaceable
from isogal.matching.usability import unusable
from isogal.scenario import Matcher as MatcherSettings

REFUSED = 3
"""Fixes in a row that a navigator has not taken, after which it is taken to have been misled by
earlier ones: the hypotheses know all that it knew at the start."""


@dataclass(frozen=True)
class Pmht:
    """The default matcher. See the module; options in `models.Options`."""

    settings: tuple[MatcherSettings, ...]
    """Of each field."""
    names: tuple[str, ...] = ("",)
    lead: int = 0
    """The field whose batch ends are everybody's: batches are of it, with those of others
    beside."""
    name: ClassVar[str] = "pmht"
    takes_channels: ClassVar[bool] = True
    takes_parameters: ClassVar[bool] = True
    """Whether it estimates the parameters of a batch (`isogal.matching.parameters`)."""
    takes_filters: ClassVar[bool] = True
    """Whether readings through a specified low-pass filter stay where they were reported."""
    learns_map_error: ClassVar[bool] = True
    """Whether its fixes say how wrong the map is (`isogal.fix.Fix.map_error`)."""
    stride: ClassVar[int] = 5
    """New scans between fixes where none is specified: with fewer the result is the same, with
    more it waits longer for what the last readings say. Measured."""
    context: ClassVar[int] = 0
    """Older scans that a batch brings along: none, what they said is in the hypotheses."""

    @classmethod
    def from_settings(cls, matcher: MatcherSettings) -> "Pmht":
        """Build it from a scenario's matcher section; raises InputError on a bad option."""
        return cls.of_fields([matcher], ("",), 0)

    @classmethod
    def of_fields(
        cls, matchers: Sequence[MatcherSettings], names: Sequence[str], lead: int
    ) -> "Pmht":
        """Build that of several fields; raises InputError on a bad option."""
        matcher = cls(tuple(matchers), tuple(names), lead)
        _ = matcher.curved  # says what is bad
        return matcher

    @cached_property
    def curved(self) -> tuple[float, ...]:
        """`models.Options.curved` of each field."""
        return tuple(options_of(one).curved for one in self.settings)

    def match(
        self, batch: Batch, field_map: AnyMap, memory: Memory | None
    ) -> tuple[Fix, Memory | None]:
        """Match one batch; see `interfaces.Matcher`."""
        each = (SecondaryBatch(self.lead, batch, field_map), *batch.secondary)
        each = tuple(displaceable(one) for one in each)
        whys = (unusable(one.batch) or _unlike(one) for one in each)
        reason = next((why for why in whys if why is not None), None)
        if reason is not None:
            silent = replace(batch, reading=np.full(len(batch), np.nan))
            if memory is None or unusable(silent) is not None:
                return declined(batch, reason), memory
        prior = batch.covariance
        if memory is None:
            passage = batch.history.passage
            slow = passage.slow[1] if passage is not None and passage.slow.size else None
            diverged = Diverged.before(prior, float(batch.time[-1]))
            memory = Memory({}, diverged, prior, slow=slow)
        else:
            memory = memory.propagated(batch)
        if reason is not None:  # of the readings: the navigator has gone on
            return declined(batch, reason), memory
        memory, rows = self._readings(each, memory, prior)
        if all(new is None for new in rows):
            return declined(batch, "there is no new reading"), memory
        observed = self._observed(each, rows, memory, prior)
        if observed is None:
            return declined(batch, "none of the likely places is on the map"), memory
        memory, information, evidence = observed
        lead = memory.fields[self.lead]
        last = memory.diverged.last._replace(rows=rows[0], evidence=evidence)
        diverged = memory.diverged.with_last(last)
        diverged = pursued(diverged, lead, field_map)
        memory, found = decided(memory._replace(diverged=diverged), self.lead, field_map)
        if not found:
            memory, found = undeceived(memory, self.lead)
        bank = memory.fields[self.lead].bank
        if bank is None:
            return declined(batch, "the place is searched for"), memory
        astray = None if found else self._astray(memory, batch, field_map)
        reset, widened = False, None
        anew = found and lead.bank is not None
        misled = astray is None and memory.refused >= REFUSED and resolved(bank)
        if anew or misled:
            mean, covariance = bank.moments()
            # outside of where it is all but sure to be (chi-square of 2 degrees of freedom)
            away = float(mean[:2] @ np.linalg.solve(prior[:2, :2], mean[:2]))
            reset = anew and away > -2.0 * math.log(RARE)
            widened = covariance + np.outer(mean, mean)  # else the fix were beyond its gate
            prior = prior + widened + (LOST_COVARIANCE if reset else 0.0)
        if found or misled:
            information = added(bank, prior, total(()))
        each_scan = self.settings[self.lead].mode == "retrodiction"
        fix, memory = published(each, memory, prior, information, self.names, each_scan, astray)
        return replace(fix, reset=reset, widened=widened), memory

    def _astray(self, memory: Memory, batch: Batch, field_map: AnyMap) -> str | None:
        """Why a navigator that may be anywhere within kilometres is not to be corrected: its
        hypotheses are not one place, or one where the readings of the last hour fit no better than
        elsewhere. None = it may be.

        So far from where they are linear, hypotheses whose readings have followed them for long
        are all too sure. Those that follow what bends the path (`States.slow`) are not."""
        lead = memory.fields[self.lead]
        sigma = longest(batch.covariance[:2, :2])
        if sigma < FEATURE_M or lead.bank is None or lead.states.slow:
            return None
        if resolved(lead.bank):
            mean, _ = lead.bank.moments()
            if probability_at(memory.diverged, lead, field_map, mean) > LIKELY:
                return None
        return f"the navigator is too unsure of its place, 1-sigma of {sigma / 1e3:.2g} km"

    def _readings(
        self, each: Sequence[SecondaryBatch], memory: Memory, prior: Array
    ) -> tuple[Memory, list[Rows | None]]:
        """Return the new readings of each field, and the memory that knows of these fields."""
        passage = each[0].batch.history.passage
        fields, rows = dict(memory.fields), []
        for one in each:
            field = fields.get(one.field)
            if field is None:
                states = States.of(one.batch, one.field_map)
                known = assumed(self.settings[one.field], one.batch, one.field_map)
                models = models_of(known, states)
                wide = longest(prior[:2, :2]) > WIDE_M
                lost = wide if one.field == self.lead else fields[self.lead].bank is None
                bank = None
                if not lost:
                    bank = Hypotheses.before(models, prior)
                    if passage is not None:
                        bank = bank.correlated(states.moving, passage.after).aided(passage, prior)
                field = FieldMemory(
                    states, models, models.shapes, bank, specified=known.sigma or 0.0
                )
            lengths, rough = field.shapes
            new, epoch = rows_of(
                one.batch, one.field_map, field.states, lengths, field.epoch, rough
            )
            fields[one.field] = field._replace(epoch=epoch)
            rows.append(new)
        return memory._replace(fields=fields), rows

    def _observed(
        self,
        each: Sequence[SecondaryBatch],
        rows: Sequence[Rows | None],
        memory: Memory,
        prior: Array,
    ) -> tuple[Memory, Information, float] | None:
        """Return the memory after new readings, what they say, and the log evidence of the first
        field's; None where none of its hypotheses is on the map.

        Readings of two fields are independent given where the vehicle was: what one says of the
        navigator informs the hypotheses of the others (expectation propagation; Minka 2001)."""
        fields, said, evidence = dict(memory.fields), dict[int, Information](), 0.0
        for one, new in zip(each, rows, strict=True):
            field = fields[one.field]
            if new is None or field.bank is None:
                continue
            bank, log = field.bank, 0.0
            if said:
                bank = bank.informed(total(said.values()), prior).normalised()
            for part in parts_of(new):
                whole = bank.split(one.field_map, part, curved=self.curved[one.field])
                seen = whole.observed(one.field_map, part)
                if not len(seen):
                    break
                log += seen.log_evidence
                bank = with_needed(seen, part.load.shape[2]).reduced(part.place[-1])
            if not len(seen):
                if one is each[0]:
                    return None
                continue
            if one is each[0]:
                evidence = log
            fields[one.field] = field._replace(bank=bank)
            said[one.field] = added(bank, prior, total(said.values()))
        order = list(said)
        for index, field in fields.items():
            since = order[order.index(index) + 1 :] if index in said else order
            if field.bank is not None and since:
                later = field.bank.informed(total(said[k] for k in since), prior).normalised()
                fields[index] = field._replace(bank=later)
        return memory._replace(fields=fields), total(said.values()), evidence


def _unlike(one: SecondaryBatch) -> str | None:
    """Why readings cannot be of a map, in one line; None where they can."""
    channels = 1 if one.batch.channel is None else one.batch.rows_per_scan
    maps = len(channels_of(one.field_map))
    if channels <= maps:
        return None
    return f"the readings have {channels} channels, the map {maps}"
