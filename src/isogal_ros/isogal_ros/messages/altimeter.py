"""Messages of a clearance meter: Range of an instrument that looks straight down, and NavSatFix
for the point on the ground below."""

import math
from typing import Any

import numpy as np
from sensor_msgs.msg import NavSatStatus

from isogal.scenario import Altimeter, Scenario
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, Framed, Place
from isogal_ros.messages.checks import BadMessageError, require_reading
from isogal_ros.messages.position import NOT_MEASURED, fill_fix
from isogal_ros.messages.stamps import set_stamp

ALTIMETER, GROUND = "altimeter_link", "ground"
"""Frame names: of the instrument, and of the point below it."""


def terrain(scenario: Scenario) -> Adapter:
    """Return the adapter of the field terrain."""
    if not scenario.altimeter.sounds:
        return AltimeterAdapter(scenario.altimeter)
    from isogal_ros.messages.soundings import PointsAdapter, ScanAdapter

    kind = PointsAdapter if scenario.altimeter.message == "points" else ScanAdapter
    return kind(scenario.altimeter)


class AltimeterAdapter(Framed):
    """Clearance and terrain height, m.

    Parameters
    ----------
    settings : Altimeter
        Limits of range of the simulated instrument; a real one says its own in each message.
    """

    raw, reduced = topics.CLEARANCE, topics.TERRAIN
    frames = ALTIMETER, GROUND

    def __init__(self, settings: Altimeter) -> None:
        self._settings = settings

    def new_raw(self) -> Any:
        """Return a message with the limits of range."""
        message = super().new_raw()
        message.min_range = self._settings.min_range
        message.max_range = self._settings.max_range
        return message

    def fill_raw(self, message: Any, ns: int, value: float, variance: float) -> None:
        """Write a clearance, m; NaN becomes infinity, which REP 117 has for nothing in range."""
        set_stamp(message.header.stamp, ns)
        message.range = math.inf if math.isnan(value) else value
        message.variance = variance

    def read_raw(self, message: Any) -> tuple[float, float | None]:
        """Return the clearance (m), NaN where it is out of range, and its variance; None = unknown
        (zero)."""
        low, high = message.min_range, message.max_range
        value, variance = message.range, message.variance
        if math.isnan(value):
            raise BadMessageError("reading is not a number")
        if low == high:
            raise BadMessageError(
                "min_range equals max_range: a ranger of fixed distance measures no distance"
            )
        if not low < high:
            raise BadMessageError(f"min_range {low:g} m is not below max_range {high:g} m")
        if not (math.isfinite(variance) and variance >= 0.0):
            raise BadMessageError(
                "negative variance" if variance < 0.0 else "variance is not finite"
            )
        in_range = math.isfinite(value) and low <= value <= high
        return (value if in_range else math.nan), variance or None

    def fill_reduced(
        self, message: Any, ns: int, value: float, variance: float, place: Place
    ) -> None:
        """Write a terrain height, m; NaN = no altitude, as the definition of the message has
        it."""
        code = NavSatStatus.STATUS_NO_FIX if math.isnan(value) else NavSatStatus.STATUS_FIX
        covariance = np.diag([NOT_MEASURED, NOT_MEASURED, variance])
        fill_fix(message, ns, *(place or (math.nan, math.nan)), value, covariance, code)

    def read_reduced(self, message: Any) -> tuple[float, float]:
        """Return the terrain height (m), NaN where there was nothing in range, and its variance
        (m²)."""
        value, variance = message.altitude, float(message.position_covariance[8])
        nothing = message.status.status == NavSatStatus.STATUS_NO_FIX and math.isnan(value)
        require_reading(0.0 if nothing else value, variance)
        return value, variance
