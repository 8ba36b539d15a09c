"""Measurements applied to the filter, and counted by the topic that they come from."""

from collections import defaultdict
from collections.abc import Callable

from isogal.fusion.measurements import Innovation, Outcome
from isogal_ros.nodes.health import ERROR, Health

SEVERAL = 3
"""So many beyond the gate in a row are no outliers: what measures is wrong, or the navigator."""


class Measuring:
    """Says of each topic what became of its measurements.

    Parameters
    ----------
    health : Health
    """

    def __init__(self, health: Health) -> None:
        self._health = health
        self._used: defaultdict[str, int] = defaultdict(int)
        self._rejected: defaultdict[str, int] = defaultdict(int)
        self._in_a_row: defaultdict[str, int] = defaultdict(int)

    def note(self, topic: str, result: Innovation) -> None:
        """Note whether a measurement was beyond the gate; one that was not ends a row."""
        rejected = result.outcome is Outcome.REJECTED
        row = self._in_a_row[topic] = self._in_a_row[topic] + 1 if rejected else 0
        if rejected:
            self._rejected[topic] += 1
            self._health.figures[f"{topic} rejected"] = self._rejected[topic]
        text = f"{row} in a row on {topic} rejected: measurement or navigator wrong"
        self._health.concern(f"rejecting {topic}", text if row >= SEVERAL else None, ERROR)

    def reading(
        self, topic: str, result: Innovation, describe: Callable[[Innovation], str]
    ) -> None:
        """Note what became of a reading, and drop one that was not used with what is wrong with
        it."""
        if result.outcome is Outcome.REFUSED:
            self._health.drop(topic, result.reason or "refused")
            return
        self.note(topic, result)
        if result.outcome is Outcome.REJECTED:
            self._health.drop(topic, f"{describe(result)} ({result.reason})")
        elif result.outcome is Outcome.UNTRUSTED:
            self._health.drop(topic, result.reason or "not used")
        else:
            self._used[topic] += 1
            self._health.figures[f"{topic} used"] = self._used[topic]
