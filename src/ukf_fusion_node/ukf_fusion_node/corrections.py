"""Fixes applied to the filter, and what became of them."""

from typing import Any

from sensor_msgs.msg import NavSatStatus

from isogal.fusion.buffered import BufferedNavigator
from isogal.matching.interfaces import LOST_SIGMA
from isogal_ros.messages.convert import read_covariance, read_position
from isogal_ros.messages.stamps import to_ns, to_seconds
from isogal_ros.nodes.health import BadMessageError, Health
from ukf_fusion_node.fixes import Extra


class Corrections:
    """Applies fixes and counts them.

    Parameters
    ----------
    health : Health
        Takes the figures of the last fix.
    """

    def __init__(self, health: Health) -> None:
        self._health = health
        self._accepted = self._refused = 0

    def apply(self, navigator: BufferedNavigator | None, message: Any, extra: Extra) -> None:
        """Correct the filter with a message on pmht_mm/fix and what belongs to it; None = it has
        not begun.

        Raises
        ------
        BadMessageError
            The fix cannot be used, or the filter refuses it.
        """
        lost, information = extra
        no_fix = message.status.status == NavSatStatus.STATUS_NO_FIX
        if no_fix and not lost:
            return
        if navigator is None:
            raise BadMessageError("came before the first IMU sample")
        stamp = to_seconds(to_ns(message.header.stamp))
        if lost:
            navigator.widen(stamp, LOST_SIGMA)
        if no_fix:
            return
        if information is not None:
            result = navigator.update_information(stamp, information.vector, information.matrix)
        else:
            latitude, longitude, _ = read_position(message)
            result = navigator.update(stamp, latitude, longitude, read_covariance(message)[:2, :2])
        self._accepted += result.accepted
        self._refused += not result.accepted
        self._health.figures |= {
            "fixes accepted": self._accepted,
            "fixes refused": self._refused,
            "innovation north": float(result.innovation[0]),
            "innovation east": float(result.innovation[1]),
            "normalised innovation squared": float(result.nis),
            "age of the last fix": float(result.late),
        }
        if not result.accepted:
            raise BadMessageError(result.reason or "refused")
