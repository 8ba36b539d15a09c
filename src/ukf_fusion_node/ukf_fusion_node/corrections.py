"""Fixes applied to the filter, and their figures in the diagnostics."""

from typing import Any

import numpy as np
from sensor_msgs.msg import NavSatStatus

from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.fix import apply_fix
from isogal.matching.interfaces import Fix
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.stamps import to_ns, to_seconds
from isogal_ros.nodes.health import Health
from ukf_fusion_node.fixes import Extra


class Corrections:
    """Applies fixes, and counts which the filter accepts.

    Parameters
    ----------
    health : Health
        Gets the figures of the last fix.
    """

    def __init__(self, health: Health) -> None:
        self._health = health
        self._accepted = self._refused = 0

    def apply(self, navigator: BufferedNavigator | None, message: Any, extra: Extra) -> None:
        """Correct the filter (None = it has not started) with a message on pmht_mm/fix and the
        information that belongs to it.

        Raises
        ------
        BadMessageError
            The fix cannot be used, or the filter refuses it.
        """
        fix = read_fix(message, extra)
        if not fix.published and fix.widening is None:
            return
        if navigator is None:
            raise BadMessageError("came before the first IMU sample")
        result = apply_fix(fix, navigator.at(fix.time))
        if result is None:
            return
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


def read_fix(message: Any, extra: Extra) -> Fix:
    """Return the fix of a message on pmht_mm/fix and the information that belongs to it.

    Position and covariance are not read where there is information, as they are not used then.

    Raises
    ------
    BadMessageError
        The message cannot be used.
    """
    lost, information = extra
    time = to_seconds(to_ns(message.header.stamp))
    nothing = np.full((2, 2), np.nan)
    if message.status.status == NavSatStatus.STATUS_NO_FIX:
        return Fix(time, np.nan, np.nan, nothing, reason="no fix", reset=lost)
    if information is not None:
        return Fix(time, np.nan, np.nan, nothing, information=information, reset=lost)
    latitude, longitude, _ = read_position(message)
    return Fix(time, latitude, longitude, read_covariance(message)[:2, :2], reset=lost)
