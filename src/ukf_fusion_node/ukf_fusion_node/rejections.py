"""Measurements beyond the innovation gate, counted (`isogal.fusion.gate`)."""

from isogal_ros.nodes.health import ERROR, Health

SEVERAL = 3
"""So many in a row are no outliers: what measures is wrong, or the navigator is."""


class Rejections:
    """Counts by topic what the filter rejects, and says where it does so again and again.

    Parameters
    ----------
    health : Health
    """

    def __init__(self, health: Health) -> None:
        self._health = health
        self._total: dict[str, int] = {}
        self._in_a_row: dict[str, int] = {}

    def note(self, topic: str, rejected: bool) -> None:
        """Note whether a measurement was rejected; one that was used ends a row."""
        row = self._in_a_row[topic] = self._in_a_row.get(topic, 0) + 1 if rejected else 0
        if rejected:
            self._total[topic] = self._total.get(topic, 0) + 1
            self._health.figures[f"{topic} rejected"] = self._total[topic]
        text = f"{row} in a row on {topic} rejected: measurement or navigator wrong"
        self._health.concern(f"rejecting {topic}", text if row >= SEVERAL else None, ERROR)
