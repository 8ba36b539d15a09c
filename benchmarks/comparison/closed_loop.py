"""CPU time of Isogal's Monte Carlo in closed loop, as a whole and by part."""

import time
from collections.abc import Callable
from typing import Any

from isogal.fusion import inertial_navigator
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch, Fix, Matcher
from isogal.matching.registry import load_matcher
from isogal.montecarlo import engine
from isogal.scenario import Scenario


class Clock:
    """CPU time spent in functions."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def watch(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*args: Any, **kwargs: Any) -> Any:
            start = time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds[name] = self.seconds.get(name, 0.0) + time.thread_time() - start

        return watched


class WatchedMatcher:
    """A matcher whose CPU time is measured, and which keeps the batches of its first run."""

    def __init__(self, inner: Matcher, clock: Clock) -> None:
        self.inner, self.name, self.context = inner, inner.name, inner.context
        self.timed = clock.watch("matching", inner.match)
        self.batches: list[Batch] = []

    def match(self, batch: Batch, field_map: FieldMap, memory: Any) -> tuple[Fix, Any]:
        if not self.batches or batch.time[-1] > self.batches[-1].time[-1]:
            self.batches.append(batch)
        answer: tuple[Fix, Any] = self.timed(batch, field_map, memory)
        return answer


def measure_closed_loop(
    scenario: Scenario, field_map: FieldMap, runs: int
) -> tuple[dict[str, float], list[Batch]]:
    """CPU seconds of a Monte Carlo, in all and by part; the batches of its first run."""
    clock = Clock()
    matcher = WatchedMatcher(load_matcher(scenario.matcher), clock)
    kept = inertial_navigator.propagate, engine.propagate_ins
    inertial_navigator.propagate = clock.watch("filter", inertial_navigator.propagate)
    engine.propagate_ins = clock.watch("strapdown", engine.propagate_ins)
    try:
        start = time.thread_time()
        engine.simulate(scenario, range(runs), field_map, matcher)
        clock.seconds["all"] = time.thread_time() - start
    finally:
        inertial_navigator.propagate, engine.propagate_ins = kept
    return clock.seconds, matcher.batches
