"""Batching and matcher of one navigator: from readings to fixes."""

import time as clock
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.fields.known_gravity import KnownGravity
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import RouteMap
from isogal.matching.failures import match_or_decline
from isogal.matching.interfaces import Batch, Fix, Matcher, declined
from isogal.matching.joint_batches import JointBatches
from isogal.matching.registry import build_run_matcher
from isogal.matching.scans import Collected
from isogal.matching.update_schedule import UpdateSchedule
from isogal.passage import Passage
from isogal.scenario import Assumed


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
        self.matcher = matcher or build_run_matcher(assumed)
        self.batches = JointBatches.of(assumed, self.matcher, gravity)
        self.memory: Any = None
        """What the matcher remembers of earlier batches."""
        self.lead = UpdateSchedule.of(assumed.each_field).lead
        """The field that says when a batch ends."""
        self._maps = tuple(maps)
        self._satellites = assumed.gnss.doubted
        self._sigmas = [one.gravimeter.sigma for one in assumed.each_field]

    @property
    def ready(self) -> bool:
        """Whether the newest readings end a batch that has not been matched yet."""
        return self.batches.ready

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
        self.batches.builders[field].add_scan(
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
        """Forget all readings, and what the matcher remembers."""
        self.batches.restore([Collected((), 0, 0)] * len(self._maps))
        self.memory = None

    def forget_scans(self) -> None:
        """Forget the readings so far, but not how many there were: batches end when they would
        have ended."""
        kept = self.batches.collected
        nothing = [
            replace(one, scans=(), unused=0, bridge=None, correction=np.zeros(BATCH_STATES))
            for one in kept
        ]
        self.batches.restore(nothing)

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
        collected = None if declined_for is None else self.batches.collected
        batch = self.batches.build(prior, self._near)
        if declined_for is not None and collected is not None:
            self.batches.restore(collected)
            return Matched(batch, declined(batch, declined_for), 0.0)
        history = replace(batch.history, satellites=self._satellites, passage=passage)
        batch = replace(batch, history=history)
        begun = clock.perf_counter()
        fix = self._fix_of(batch)
        seconds = clock.perf_counter() - begun
        self.batches.learn(fix)
        return Matched(batch, fix, seconds)

    def _fix_of(self, batch: Batch) -> Fix:
        if not self.batches.whole:
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
