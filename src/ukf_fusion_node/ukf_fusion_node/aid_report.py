"""Which aids the navigator uses, since when not, and why: nav/aids."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import Innovation
from isogal.fusion.state import FilterState
from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds, set_stamp, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import OK, WARN, status


@dataclass
class _Aid:
    """One aid, by its topic."""

    silent: int
    """ns without a measurement that was used after which it is not in use."""
    used: int = 0
    not_used: int = 0
    newest: int = -1
    """Stamp of the last measurement that was used; -1 = there was none."""
    why: str = "nothing has come yet"
    """Why the last was not used."""
    seen: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=JUDGED))
    """Normalised innovation squared and dimensions of the newest measurements that were used."""

    @property
    def nis(self) -> float:
        """Their mean per dimension."""
        return sum(one for one, _ in self.seen) / max(1, sum(size for _, size in self.seen))

    @property
    def unlike(self) -> str | None:
        """Say that the noise is not what it is said to be; None = it may be."""
        if len(self.seen) < JUDGED or LIKELY[0] <= self.nis <= LIKELY[1]:
            return None
        return f"innovations are {math.sqrt(self.nis):.2g} times as large as its covariance says"


JUDGED = 100
"""Measurements over which the mean of the normalised innovations squared is judged."""
LIKELY = 0.5, 2.0
"""What it may be: of 100 numbers of one dimension its 1-sigma is sqrt(2 / 100) = 0.14, so that
honest ones are outside once in 2,000 below and never above; slow errors that are no states, and
covariances that are rounded up, are what is found."""
LOST_AFTER = 3.0
"""Intervals without a measurement that is used, after which an aid is not in use."""

SIGMA = "horizontal 1-sigma"


class AidReport:
    """Publishes the state of each aid, once a period and when one is lost or comes back.

    Parameters
    ----------
    node : GraphNode
    """

    def __init__(self, node: GraphNode) -> None:
        self._health = node.health
        self._publisher = node.advertise(topics.NAV_AIDS)
        self._message = topics.NAV_AIDS.type()
        self._period = from_seconds(node.settings.diagnostics_period)
        self._space = node.get_namespace().strip("/")
        self._aids: dict[str, _Aid] = {}
        self._said: tuple[str, ...] = ()
        self._last = -1

    def add(self, topic: str, interval: float) -> None:
        """Expect measurements of a topic, one in an interval (s)."""
        self._aids[topic] = _Aid(from_seconds(LOST_AFTER * interval))

    def note(self, topic: str, stamp: int, result: Innovation) -> None:
        """Note what became of a measurement of a stamp (ns)."""
        aid = self._aids[topic]
        if result.used:
            aid.newest, aid.used = max(stamp, aid.newest), aid.used + 1
            dimensions = max(1, len(result.innovation))
            if math.isfinite(result.nis):  # it is not known while a navigator is being aligned
                aid.seen.append((result.nis, dimensions))
            self._health.concern(f"noise {topic}", self._said_of(topic, aid))
        else:
            self.absent(topic, result.reason or "not used")

    def _said_of(self, topic: str, aid: _Aid) -> str | None:
        return None if aid.unlike is None else f"{topic}: {aid.unlike}"

    def absent(self, topic: str, why: str) -> None:
        """Note that a message of a topic could not be used, and why."""
        aid = self._aids[topic]
        aid.not_used, aid.why = aid.not_used + 1, why

    def in_use(self, ns: int) -> tuple[str, ...]:
        """Return the aids that are in use at a stamp (ns)."""
        return tuple(
            name
            for name, aid in self._aids.items()
            if aid.newest >= 0 and ns - aid.newest <= aid.silent
        )

    def tick(self, ns: int, navigator: InertialNavigator) -> None:
        """Publish at a stamp (ns) of the navigator, if it is time or something has changed."""
        if not self._aids:
            return
        in_use = self.in_use(ns)
        if in_use == self._said and 0 <= ns - self._last < self._period:
            return
        self._said, self._last = in_use, ns
        set_stamp(self._message.header.stamp, ns)
        self._message.status = [
            self._status(name, aid, name in in_use) for name, aid in self._aids.items()
        ]
        self._message.status.append(self._navigator(navigator))
        self._publisher.publish(self._message)

    def _navigator(self, navigator: InertialNavigator) -> DiagnosticStatus:
        """Return how well the position is known, and how well it would be without satellites."""
        text, figures = "no satellites are used", {SIGMA: _sigma(navigator.state)}
        if (without := navigator.without_satellites) is not None:
            sigma = _sigma(without.after.merged)
            text = f"without satellites since {without.since:.0f} s it would be {sigma:.0f} m"
            figures |= {f"{SIGMA} without satellites": sigma, "without since": without.since}
        return status(self._label(topics.NAVIGATOR), OK, text, figures)

    def _label(self, name: str) -> str:
        return f"{self._space}/{name}" if self._space else name

    def _status(self, name: str, aid: _Aid, used: bool) -> DiagnosticStatus:
        since = "never" if aid.newest < 0 else f"not since {to_seconds(aid.newest):.0f} s"
        text = "used" if used else f"{since}: {aid.why}"
        figures = {
            "used": aid.used,
            "not used": aid.not_used,
            "last used": to_seconds(aid.newest) if aid.newest >= 0 else None,
            "normalised innovation squared": aid.nis,
        }
        return status(self._label(name), OK if used else WARN, text, figures)


def _sigma(state: FilterState) -> float:
    """Return the 1-sigma of the position along the worst horizontal direction, m."""
    return float(np.sqrt(np.linalg.eigvalsh(state.covariance[:2, :2])[-1]))
