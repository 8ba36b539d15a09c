"""Batching and matcher of one navigator: from readings to fixes."""

import math
import time as clock
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.fields.known_gravity import KnownGravity, residual_gravity
from isogal.maps.channels import RouteMap
from isogal.matching.batching import BatchBuilder
from isogal.matching.failures import match_or_decline
from isogal.matching.interfaces import Batch, Fix, Matcher, SecondaryBatch, declined
from isogal.matching.registry import build_run_matcher, leading_field, time_between_fixes
from isogal.matching.residual_gravity import ResidualGravity
from isogal.matching.scans import Collected
from isogal.passage import Passage
from isogal.scenario import Assumed
from isogal.sensors.trajectory import build_trajectory


class Matched(NamedTuple):
    """A batch and its fix."""

    batch: Batch
    fix: Fix
    seconds: float
    """s that the matcher took."""


class MapMatching:
    """Collects the readings of one navigator, and matches the batches that they make.

    Parameters
    ----------
    assumed : Assumed
    maps : sequence of RouteMap
        Of each field.
    matcher : Matcher, optional
        Default: that of section `matcher`.
    gravity : KnownGravity, optional
        What the navigator knows of horizontal gravity; default: as it is assumed.

    Raises
    ------
    InputError
        What is assumed, or its matcher, cannot be used.
    """

    def __init__(
        self,
        assumed: Assumed,
        maps: Sequence[RouteMap],
        matcher: Matcher | None = None,
        gravity: KnownGravity | None = None,
    ) -> None:
        each = assumed.each_field
        self.matcher = matcher or build_run_matcher(assumed)
        self.memory: Any = None
        """What the matcher remembers of earlier batches."""
        self.lead = leading_field(each)
        """The field that says when a batch ends."""
        between = time_between_fixes(each[self.lead])
        # of the leading field's batch ends, how many there may be in a batch of another
        spans = [one.matcher.batch_length * one.gravimeter.interval for one in each]
        marks = [math.ceil(span / between) + 1 for span in spans]
        marks[self.lead] = 0
        self.builders = [
            BatchBuilder(one, self.matcher.context, most)
            for one, most in zip(each, marks, strict=True)
        ]
        if gravity is None:
            gravity = residual_gravity(assumed.gravity_field, build_trajectory(assumed))
        self._gravity = gravity
        self._maps = tuple(maps)
        self._satellites = assumed.gnss.doubted
        self._sigmas = [one.gravimeter.sigma for one in each]
        self.begin_anew()

    @property
    def ready(self) -> bool:
        """Whether the newest readings end a batch that has not been matched yet."""
        return self.builders[self.lead].ready

    @property
    def collected(self) -> tuple[Collected, ...]:
        """What has been collected of each field."""
        return tuple(builder.collected for builder in self.builders)

    def restore(self, collected: Sequence[Collected]) -> None:
        """Go on from what was collected earlier."""
        for builder, one in zip(self.builders, collected, strict=True):
            builder.collected = one

    def add(
        self,
        field: int,
        time: float,
        position: Array,
        velocity: Array,
        reading: float | Array,
        variance: float = 0.0,
    ) -> None:
        """Add a reading, reduced with the navigator's state of its time.

        Parameters
        ----------
        field : int
            Its place in the list of fields.
        time : float
            s.
        position : (3,) array
            Latitude rad, longitude rad, height m.
        velocity : (2,) or (3,) array
            North, east, m/s.
        reading : float or (C,) array
            NaN = none.
        variance : float
            Of its white noise, as its message says; 0 = as it is assumed.
        """
        self.builders[field].add_scan(
            time,
            float(position[0]),
            float(position[1]),
            velocity[:2],
            reading,
            variance**0.5 if variance > 0.0 else self._sigmas[field],
            height=float(position[2]),
        )

    def use(self, matcher: Matcher) -> None:
        """Match with another matcher from the next batch on."""
        self.matcher, self.memory = matcher, None

    def begin_anew(self) -> None:
        """Forget all readings, what the matcher remembers, and what is learnt of gravity."""
        gravity = ResidualGravity.of(self._gravity)
        for builder in self.builders:
            nothing = builder.collected.scans.part(slice(0))
            builder.collected = Collected(nothing, gravity=gravity)
        self.memory = None

    def forget_scans(self) -> None:
        """Forget the readings so far, but not how many there were: batches end when they would
        have ended."""
        for builder in self.builders:
            known = builder.collected
            nothing = Collected(known.scans.part(slice(0)), known.count, gravity=known.gravity)
            builder.collected = nothing

    def bridge(self, begin: float, before: Array, end: float, after: Array) -> None:
        """See `BatchBuilder.bridge`."""
        for builder in self.builders:
            builder.bridge(begin, before, end, after)

    def correct(self, time: float, jump: Array) -> None:
        """See `BatchBuilder.correct`."""
        for builder in self.builders:
            builder.correct(time, jump)

    def match(
        self,
        prior: Array,
        declined_for: str | None = None,
        passage: Passage | None = None,
    ) -> Matched:
        """Return the batch that the newest readings end, and its fix.

        Parameters
        ----------
        prior : (7, 7) array
            The navigator's covariance, of a batch's states (`isogal.inertial.error_state`).
        declined_for : str, optional
            Why there can be no fix; the readings then belong to the next batch, too.
        passage : Passage, optional
            What has become of the navigator's error since the last batch.
        """
        collected = self.collected
        batch = self._build(prior)
        if declined_for is not None:
            self.restore(collected)
            return Matched(batch, declined(batch, declined_for), 0.0)
        history = replace(batch.history, satellites=self._satellites, passage=passage)
        batch = replace(batch, history=history)
        begun = clock.perf_counter()
        fix = self._fix_of(batch)
        seconds = clock.perf_counter() - begun
        self._learn(fix)
        return Matched(batch, fix, seconds)

    def _build(self, prior: Array) -> Batch:
        """Return the batch of the first field, with those of others that have new readings beside
        it: where another has no scan at the batch's end an empty one marks it."""
        lead = self.builders[self.lead]
        batch = lead.build(prior)
        secondary = []
        for field, builder in enumerate(self.builders):
            if field == self.lead or not builder.whole:
                continue
            # one that has gone on beyond this end has its turn at the next
            if builder.mark(lead) and builder.has_new:
                other = builder.build(prior)
                secondary.append(SecondaryBatch(field, other, self._near(field, other)))
        return replace(batch, secondary=tuple(secondary))

    def _learn(self, fix: Fix) -> None:
        """Note what the fix of a batch says of the gravity map's error."""
        residual = self._gravity.residual
        if fix.map_error is not None and residual is not None:
            gravity = ResidualGravity(*residual.given(*fix.map_error))
            for builder in self.builders:
                builder.collected = replace(builder.collected, gravity=gravity)

    def _fix_of(self, batch: Batch) -> Fix:
        if not self.builders[self.lead].whole:
            return declined(batch, f"the first batch is not whole: it has {len(batch)} scans")
        try:
            near = self._near(self.lead, batch)
        except InputError as error:
            return declined(batch, f"no map around the batch: {error}")
        fix, self.memory = match_or_decline(self.matcher, batch, near, self.memory)
        return fix

    def _near(self, field: int, batch: Batch) -> Any:
        """Return the map of a field around a batch."""
        return self._maps[field].near(batch.latitude, batch.longitude)
