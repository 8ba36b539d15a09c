"""CPU time of Isogal's Monte Carlo in closed loop, as a whole and by part."""

from typing import TypeVar
from unittest.mock import patch

from clock import Clock

from isogal.fusion import inertial_navigator
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch, Fix, Matcher
from isogal.matching.registry import load_matcher
from isogal.montecarlo import engine
from isogal.scenario import Scenario

Memory = TypeVar("Memory")


class WatchedMatcher:
    """A matcher whose CPU time is measured, and which keeps the batches of its first run."""

    def __init__(self, inner: Matcher, clock: Clock) -> None:
        self.inner, self.name, self.context = inner, inner.name, inner.context
        self.timed = clock.timed("matching", inner.match)
        self.batches: list[Batch] = []

    def match(self, batch: Batch, field_map: FieldMap, memory: Memory) -> tuple[Fix, Memory]:
        """Match one batch; see `isogal.matching.interfaces.Matcher`."""
        if not self.batches or batch.time[-1] > self.batches[-1].time[-1]:
            self.batches.append(batch)
        return self.timed(batch, field_map, memory)


def measure_closed_loop(
    scenario: Scenario, field_map: FieldMap, runs: int
) -> tuple[dict[str, float], list[Batch]]:
    """CPU seconds of a Monte Carlo, in all and by part; the batches of its first run."""
    clock = Clock()
    matcher = WatchedMatcher(load_matcher(scenario.matcher), clock)
    filtering = clock.timed("filter", inertial_navigator.propagate)
    strapdown = clock.timed("strapdown", engine.propagate_ins)
    with (
        patch.object(inertial_navigator, "propagate", filtering),
        patch.object(engine, "propagate_ins", strapdown),
    ):
        clock.timed("rest", engine.simulate)(scenario, range(runs), field_map, matcher)
    return clock.seconds | {"all": sum(clock.seconds.values())}, matcher.batches
