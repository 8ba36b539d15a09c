"""Fixes applied to the filter, and their figures in the diagnostics."""

from collections.abc import Callable

import numpy as np
from rclpy.impl.rcutils_logger import RcutilsLogger as Logger
from sensor_msgs.msg import NavSatFix, NavSatStatus, PointCloud2

from isogal.fix import Fix
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import Innovation, Outcome, measurements_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.messages.whole_fix import WholeFix, read_whole_fix
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import Health
from isogal_ros.topics import FIX, INFORMATION
from ukf_fusion_node.fixes import FixQueue
from ukf_fusion_node.measuring import Measuring
from ukf_fusion_node.navigation import Navigation

IMPROBABLE = 23.0
"""Normalised innovation squared that one fix in 100,000 exceeds, two degrees of freedom."""

LOG_EVERY = 5.0
"""s of wall time between lines about fixes."""


class Corrections:
    """Applies fixes, and counts which the filter accepts.

    Parameters
    ----------
    health : Health
        Gets the figures of the last fix.
    log : logger, optional
        Gets a line for a fix, at most one in `LOG_EVERY`.
    unfit : callable, optional
        Called when a fix does not agree with the navigator.
    """

    def __init__(
        self, health: Health, log: Logger | None = None, unfit: Callable[[], None] = lambda: None
    ) -> None:
        self._health, self._log, self._unfit = health, log, unfit
        self._measuring = Measuring(health)
        self._odd = 0
        self._accepted = self._refused = 0

    def apply(self, navigator: InertialNavigator | None, content: WholeFix | NavSatFix) -> None:
        """Correct the filter (None = it has not started) with a whole fix, or with a NavSatFix
        that is all there is.

        Raises
        ------
        BadMessageError
            The fix cannot be used, or the filter refuses it.
        """
        whole = content if isinstance(content, WholeFix) else WholeFix(read_fix(content))
        fix = whole.fix
        if fix.reset:
            self._unfit()
        parts = [(fix.time, part) for part in measurements_of(fix, whole.relative_to)]
        if navigator is None and (fix.published or fix.widening is not None):
            raise BadMessageError("came before the first IMU sample")
        if navigator is None or not parts:
            return
        late = navigator.time - fix.time
        result = navigator.measure_all(parts)[-1]
        if not fix.published:
            return
        self._accepted += result.used
        self._refused += not result.used
        self._health.figures |= {
            "fixes accepted": self._accepted,
            "fixes refused": self._refused,
            "innovation north": float(result.innovation[0]),
            "innovation east": float(result.innovation[1]),
            "normalised innovation squared": float(result.nis),
            "age of the last fix": float(late),
        }
        self._judge(result, late)
        if not result.used:
            raise BadMessageError(result.reason or "refused")

    def _judge(self, result: Innovation, late: float) -> None:
        """Say where the fixes do not fit the navigator, one after the other."""
        rejected = result.outcome is Outcome.REJECTED
        if result.used or rejected:
            self._measuring.note(FIX.name, result)
        odd = rejected or (result.used and result.nis > IMPROBABLE)
        self._odd = self._odd + 1 if odd else 0
        if odd:
            self._unfit()
        text = f"{self._odd} fixes in a row are improbable for the navigator"
        self._health.concern("improbable", text if self._odd >= 2 else None)
        if result.used and self._log is not None:
            moved = float(np.hypot(*result.innovation))
            self._log.info(
                f"{late:.0f} s old fix taken; {moved:.0f} m from the estimate",
                throttle_duration_sec=LOG_EVERY,
            )


def read_fix(message: NavSatFix) -> Fix:
    """Return the fix of a NavSatFix; raises BadMessageError where it cannot be used."""
    time = to_seconds(to_ns(message.header.stamp))
    if message.status.status == NavSatStatus.STATUS_NO_FIX:
        nothing = np.full((2, 2), np.nan)
        return Fix(time, np.nan, np.nan, nothing, reason="no fix")
    latitude, longitude, _ = read_position(message)
    return Fix(time, latitude, longitude, read_covariance(message)[:2, :2])


class Fixes:
    """Hears the matcher's fixes, and applies each when it is its turn.

    Parameters
    ----------
    node : GraphNode
    navigation : Navigation
    within : callable
        Whether something has been published of a time after the newest step: fixes then wait for
        the next.
    answer : callable
        Called after each fix, even one that is dropped.
    """

    def __init__(
        self,
        node: GraphNode,
        navigation: Navigation,
        within: Callable[[], bool],
        answer: Callable[[], None],
    ) -> None:
        self._guard, self._navigation, self._within = node.guard, navigation, within
        self._answer = answer
        self._corrections = Corrections(node.health, node.get_logger(), navigation.unfit)
        node.listen(FIX, self._take_fix)
        whole = node.listen(INFORMATION, self._take_whole)
        ahead = from_seconds(node.settings.max_gap)
        self._queue = FixQueue(whole.get_publisher_count, ahead, node.monotonic)

    def _take_whole(self, message: PointCloud2) -> None:
        self._queue.add_whole(to_ns(message.header.stamp), read_whole_fix(message))
        self.settle()

    def _take_fix(self, message: NavSatFix) -> None:
        try:
            self._queue.add_position(to_ns(message.header.stamp), message)
        except BadMessageError:
            self._answer()
            raise
        self.settle()

    def settle(self) -> None:
        """Apply the fixes that need not wait, and answer each, even one that is dropped."""
        if self._within() or not self._queue:
            return
        for ns, content in self._queue.due(self._navigation.ns):
            self._guard(FIX, self._corrections.apply, self._navigation.navigator, content)
            self._navigation.matched(ns)
            self._answer()
