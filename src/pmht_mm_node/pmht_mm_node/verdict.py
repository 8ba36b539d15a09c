"""What a matcher's batches, one after the other, say of the navigator and the map, and where the
node tells it: log, diagnostics, figures."""

import math

import numpy as np

from isogal.fields.measured import unlikely_sigmas
from isogal.matching.failures import UNEXPLAINED
from isogal.matching.interfaces import SATELLITES, Fix
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import ERROR, OK, WARN, Figure, status

FEW, MANY = 3, 10
"""Batches in a row without a fix after which that is a warning, and an error."""
LOG_EVERY = 5.0
"""s of wall time between lines about fixes."""
AGREED = 10
"""Fixes in a row after which a place that was found is believed: a map that is not what it is
taken for has places, too, that fit some batches."""
LIKELY, CERTAIN = 0.5, 0.95
"""Probability from which on it is said that the navigator is somewhere else, and that something is
not as it was told."""
DOUBTS = {
    UNEXPLAINED: "readings and map do not agree",
    "biased": "readings and map do not agree: there is a constant between them",
    "navigator": "errors of the navigator are larger than it says",
    "noisier": "readings are noisier",
    "late": "readings are late",
    "filtered": "readings are a mean over the path",
}
"""What figures of a fix are the probability of (`isogal.matching.pmht.models`)."""


class Verdict:
    """Level and text for the diagnostics, batch by batch."""

    def __init__(self) -> None:
        self.level: bytes = OK
        self.text = "matching"
        self.found = False
        """Whether the last batch has found a navigator that was lost."""
        self._without = self._misfits = self._failures = 0
        self._lost = False
        self._agreed: int | None = None
        """Fixes since it was found; None = it was not lost."""

    def take(self, fix: Fix) -> None:
        """Judge the next batch."""
        self.found = fix.published and (self._lost or fix.reset)
        self._lost = (self._lost or fix.reset) and not fix.published
        wanted = fix.reason != SATELLITES
        self._without = self._without + 1 if not fix.published and wanted else 0
        self._failures = self._failures + 1 if fix.failed else 0
        misfit = not fix.published and fix.diagnostics.get(UNEXPLAINED, 0.0) > LIKELY
        self._misfits = self._misfits + 1 if misfit else 0
        if self.found or self._lost or (self._agreed is not None and misfit):
            self._agreed = 0
        elif self._agreed is not None:
            self._agreed += fix.published
        if self._agreed == AGREED:
            self._agreed = None
        self.level, self.text = self._judge(fix)

    def _judge(self, fix: Fix) -> tuple[bytes, str]:
        why = f"{self._without} batches without a fix: {fix.reason}"
        if self._lost:
            return ERROR, f"the navigator is lost: {fix.reason}"
        if self.found:
            return WARN, "the navigator was lost and has been told where it is"
        if fix.diagnostics.get("diverged", 0.0) > LIKELY:
            return WARN, "the navigator may be lost: readings fit better elsewhere"
        if max(self._misfits, self._failures) >= FEW or self._without >= MANY:
            return ERROR, why
        if self._misfits or self._failures or self._without >= FEW:
            return WARN, why
        for name, words in DOUBTS.items():
            if fix.diagnostics.get(name, 0.0) > CERTAIN:
                return WARN, f"the readings do not fit what is specified: {words}"
        if self._agreed is not None:
            words = f"{self._agreed} fixes have agreed with it; {AGREED} are wanted"
            return WARN, f"the navigator was lost and has been told where it is: {words}"
        return OK, "matching" if fix.reason != SATELLITES else f"matching; {SATELLITES}"


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


def line(ns: int, fix: Fix) -> str:
    """Return what the log says of a batch."""
    if not fix.published:
        return f"{to_seconds(ns):.0f} s: no fix: {fix.reason}"
    sigma = math.sqrt(float(np.trace(fix.covariance)))
    return f"{to_seconds(ns):.0f} s: fix with a 1-sigma of {sigma:.0f} m"
