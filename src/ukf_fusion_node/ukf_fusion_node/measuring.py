"""What became of measurements, counted by the topic that they come from, and said on nav/aids."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import Innovation, Outcome
from isogal.fusion.state import FilterState
from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds, set_stamp, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import ERROR, OK, WARN, Health, status

SEVERAL = 3
"""So many beyond the gate in a row are no outliers: what measures is wrong, or the navigator."""
JUDGED = 100
"""Measurements over which the mean of the normalised innovations squared is judged."""
LIKELY = 0.5, 2.0
"""What it may be: of 100 numbers of one dimension its 1-sigma is sqrt(2 / 100) = 0.14, so that
honest ones are outside once in 2,000 below and never above; slow errors that are no states, and
covariances that are rounded up, are what is found."""
LOST_AFTER = 3.0
"""Intervals without a measurement that is used, after which an aid is not in use."""
SIGMA = "horizontal 1-sigma"
Describe = Callable[[Innovation], str]
"""Says of a measurement beyond the gate what is wrong with it."""


class Measured:
    """Counts the measurements of one topic, and says in the diagnostics what is wrong with them.

    Parameters
    ----------
    topic : str
    health : Health
    interval : float
        s between measurements.
    """

    def __init__(self, topic: str, health: Health, interval: float = 0.0) -> None:
        self._topic, self._health = topic, health
        self._silent = from_seconds(LOST_AFTER * interval)
        self.used = self.not_used = 0
        self.newest = -1
        """Stamp of the last measurement that was used; -1 = there was none."""
        self.why = "nothing has come yet"
        """Why the last was not used."""
        self._in_a_row = 0
        self._seen: deque[tuple[float, int]] = deque(maxlen=JUDGED)
        """Normalised innovation squared and dimensions of the newest measurements that were
        used."""

    def judge(self, result: Innovation) -> None:
        """Note whether a measurement was beyond the gate; one that was not ends a row."""
        rejected = result.outcome is Outcome.REJECTED
        self._in_a_row = self._in_a_row + 1 if rejected else 0
        if rejected:
            self._health.count(f"{self._topic} rejected")
        row = f"{self._in_a_row} in a row on {self._topic} rejected"
        text = f"{row}: measurement or navigator wrong" if self._in_a_row >= SEVERAL else None
        self._health.concern(f"rejecting {self._topic}", text, ERROR)

    def take(self, stamp: int, result: Innovation, describe: Describe | None) -> None:
        """Note what became of a measurement of a stamp (ns), and drop one that was not used with
        what is wrong with it; `describe` says that of one beyond the gate (None = its reason
        does)."""
        if result.outcome is not Outcome.REFUSED:
            self.judge(result)
        if not result.used:
            why = result.reason or "not used"
            self.absent(why)
            rejected = result.outcome is Outcome.REJECTED
            said = f"{describe(result)} ({why})" if describe is not None and rejected else why
            self._health.drop(self._topic, said)
            return
        self.newest, self.used = max(stamp, self.newest), self.used + 1
        self._health.figures[f"{self._topic} used"] = self.used
        if math.isfinite(result.nis):  # it is not known while a navigator is being aligned
            self._seen.append((result.nis, max(1, len(result.innovation))))
        self._health.concern(f"noise {self._topic}", self._unlike)

    def absent(self, why: str) -> None:
        """Note that a message could not be used, and why."""
        self.not_used, self.why = self.not_used + 1, why

    @property
    def has_come(self) -> bool:
        """Whether there was any message."""
        return self.used + self.not_used > 0

    def in_use(self, ns: int) -> bool:
        """Whether measurements are used at a stamp (ns)."""
        return self.newest >= 0 and ns - self.newest <= self._silent

    @property
    def nis(self) -> float:
        """Mean normalised innovation squared per dimension of the newest that were used."""
        return sum(one for one, _ in self._seen) / max(1, sum(size for _, size in self._seen))

    @property
    def _unlike(self) -> str | None:
        """Say that the noise is not what it is said to be; None = it may be."""
        if len(self._seen) < JUDGED or LIKELY[0] <= self.nis <= LIKELY[1]:
            return None
        times = f"{math.sqrt(self.nis):.2g} times"
        return f"{self._topic}: innovations are {times} as large as its covariance says"

    def status(self, name: str, used: bool) -> DiagnosticStatus:
        """Return what there is to say of the aid, under a name."""
        newest = to_seconds(self.newest) if self.newest >= 0 else None
        since = "never" if newest is None else f"not since {newest:.0f} s"
        figures = {
            "used": self.used,
            "not used": self.not_used,
            "last used": newest,
            "normalised innovation squared": self.nis,
        }
        text = "used" if used else f"{since}: {self.why}"
        return status(name, OK if used else WARN, text, figures)


class AidReport:
    """Publishes the state of each aid on nav/aids, once a period and when one is lost or comes
    back.

    Parameters
    ----------
    node : GraphNode
    aids : sequence of mappings
        Of each aid the topics on which it may come, the usual one first. Of one that has come on
        another, or not at all, nothing is said of the topics on which it never came.
    """

    def __init__(self, node: GraphNode, aids: Sequence[Mapping[str, Measured]]) -> None:
        self._each, self._publisher = aids, node.advertise(topics.NAV_AIDS)
        self._aids = {name: one for either in aids for name, one in either.items()}
        self._message = topics.NAV_AIDS.type()
        self._period = from_seconds(node.settings.diagnostics_period)
        self._space = f"{node.get_namespace().strip('/')}/".lstrip("/")
        self._said: tuple[str, ...] = ()
        self._last = -1

    def tick(self, ns: int, navigator: InertialNavigator) -> None:
        """Publish at a stamp (ns) of the navigator, if it is time or something has changed."""
        if not self._aids:
            return
        in_use = tuple(name for name, aid in self._aids.items() if aid.in_use(ns))
        if in_use == self._said and 0 <= ns - self._last < self._period:
            return
        self._said, self._last = in_use, ns
        set_stamp(self._message.header.stamp, ns)
        self._message.status = [
            self._aids[name].status(self._space + name, name in in_use)
            for either in self._each
            for name in [name for name, aid in either.items() if aid.has_come] or list(either)[:1]
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
        return status(self._space + topics.NAVIGATOR, OK, text, figures)


def _sigma(state: FilterState) -> float:
    """Return the 1-sigma of the position along the worst horizontal direction, m."""
    return float(np.sqrt(np.linalg.eigvalsh(state.covariance[:2, :2])[-1]))
