"""What the node says of its batches: log, diagnostics, figures."""

from isogal.fields.measured import unlikely_sigmas
from isogal.matching.interfaces import Fix
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import Figure, status
from pmht_mm_node.verdict import Verdict, line

LOG_EVERY = 5.0
"""s of wall time between lines about fixes."""


class Report:
    """Counts fixes and tells what became of each batch.

    Parameters
    ----------
    node : GraphNode
        Whose health and log.
    """

    def __init__(self, node: GraphNode) -> None:
        self._health, self._logger = node.health, node.get_logger()
        self._verdict = Verdict()
        for text in unlikely_sigmas(node.scenario):
            self._logger.warning(text)

    def say(self, ns: int, fix: Fix, seconds: float) -> None:
        """Tell of a batch that ended at a stamp and took some seconds, with the matcher's own
        figures."""
        self._health.count("fixes published", fix.published)
        self._health.count("fixes declined", not fix.published)
        self._health.count("matcher failures", fix.failed)
        self._verdict.take(fix)
        if self._verdict.found:
            self._logger.warning("the navigator was lost and has been told where it is")
        self._health.state(self._verdict.level, self._verdict.text)
        self._logger.info(line(ns, fix), throttle_duration_sec=LOG_EVERY)
        figures: dict[str, Figure] = {
            "stamp": f"{to_seconds(ns):.9f}",
            "published": fix.published,
            "status": fix.status.value,
            "seconds": seconds,
            **fix.diagnostics,
        }
        name, words = f"{self._health.name}: batch", fix.reason or "fix published"
        self._health.publish(status(name, self._verdict.level, words, figures))
