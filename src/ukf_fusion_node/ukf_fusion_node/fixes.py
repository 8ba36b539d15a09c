"""The matcher's fixes: each is used once, when it is its turn.

A fix comes with its information on pmht_mm/information. Its position on pmht_mm/fix is for all
others, and is used only where nobody publishes the information."""

from collections.abc import Callable

import numpy as np
from sensor_msgs.msg import NavSatFix, PointCloud2

from isogal.fusion.measurements import Innovation, Outcome, measurements_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.fix_information import FixMessage, read_fix, read_fix_information
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import FIX, INFORMATION, Message
from ukf_fusion_node.measuring import Measured
from ukf_fusion_node.navigation import Navigation
from ukf_fusion_node.settings import UkfFusionSettings
from ukf_fusion_node.stamp_queue import StampQueue

IMPROBABLE = 23.0
"""Normalised innovation squared that one fix in 100,000 exceeds, two degrees of freedom."""
LOG_EVERY = 5.0
"""s of wall time between lines about fixes."""


class Fixes:
    """Hears the matcher's fixes, applies each to the filter when it is its turn, and counts which
    it accepts.

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
        node: GraphNode[UkfFusionSettings],
        navigation: Navigation,
        within: Callable[[], bool],
        answer: Callable[[], None],
    ) -> None:
        self._guard, self._navigation, self._within = node.guard, navigation, within
        self._answer, self._health, self._log = answer, node.health, node.get_logger()
        self._measured, self._odd = Measured(FIX.name, node.health), 0
        self._queue = StampQueue[FixMessage](from_seconds(node.settings.max_gap))
        node.listen(FIX, self._take_position)
        self._information = node.listen(
            INFORMATION, lambda one: self._take(one, read_fix_information)
        )

    def _take_position(self, message: NavSatFix) -> None:
        if not self._information.get_publisher_count():
            self._take(message, read_fix)

    def _take(
        self, message: NavSatFix | PointCloud2, read: Callable[[Message], FixMessage]
    ) -> None:
        try:
            self._queue.add(to_ns(message.header.stamp), read(message))
        except BadMessageError:
            self._answer()
            raise
        self.settle()

    def settle(self) -> None:
        """Apply the fixes that need not wait, and answer each, even one that is dropped."""
        if self._within() or not self._queue:
            return
        for ns, message in self._queue.due(self._navigation.ns):
            self._guard(FIX, self._apply, message)
            self._navigation.matched(ns)
            self._answer()

    def begin_anew(self) -> None:
        """Forget the fixes that have come: time may begin anew."""
        self._queue.forget()

    def _apply(self, message: FixMessage) -> None:
        """Correct the filter; raises BadMessageError where the fix cannot be used, or the filter
        refuses it."""
        fix, navigator = message.fix, self._navigation.navigator
        if fix.reset:
            self._navigation.unfit()
        parts = [(fix.time, part) for part in measurements_of(fix, message.relative_to)]
        if navigator is None and (fix.published or fix.widening is not None):
            raise BadMessageError("came before the first IMU sample")
        if navigator is None or not parts:
            return
        late = navigator.time - fix.time
        result = navigator.measure_all(parts)[-1]
        if not fix.published:
            return
        self._health.count("fixes accepted", result.used)
        self._health.count("fixes refused", not result.used)
        self._health.figures |= {
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
            self._measured.judge(result)
        odd = rejected or (result.used and result.nis > IMPROBABLE)
        self._odd = self._odd + 1 if odd else 0
        if odd:
            self._navigation.unfit()
        text = f"{self._odd} fixes in a row are improbable for the navigator"
        self._health.concern("improbable", text if self._odd >= 2 else None)
        if result.used:
            moved = float(np.hypot(*result.innovation))
            self._log.info(
                f"{late:.0f} s old fix taken; {moved:.0f} m from the estimate",
                throttle_duration_sec=LOG_EVERY,
            )
