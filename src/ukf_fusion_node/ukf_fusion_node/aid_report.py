"""Which aids the navigator uses, since when not, and why: nav/aids."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.state import FilterState
from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds, set_stamp, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import OK, WARN, status
from ukf_fusion_node.measuring import Measured

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
        self._aids: dict[str, Measured] = {}
        self._said: tuple[str, ...] = ()
        self._last = -1

    def add(self, topic: str, interval: float) -> Measured:
        """Expect measurements of a topic, one in an interval (s); return what counts them."""
        self._aids[topic] = Measured(topic, self._health, interval)
        return self._aids[topic]

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

    def _status(self, name: str, aid: Measured, used: bool) -> DiagnosticStatus:
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
