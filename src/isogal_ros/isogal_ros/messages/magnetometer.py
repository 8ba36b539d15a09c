"""Messages of a magnetometer: MagneticField, in tesla."""

import math
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.maps.quantities import QUANTITIES
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, Framed, Place
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_reading
from isogal_ros.messages.stamps import set_stamp

MAGNETOMETER, MAIN_FIELD = "magnetometer_link", "main_field"
"""Frame names. `main_field` has its z axis along the main field, the direction in which an anomaly
counts."""
TESLA = 1e-9
"""T in 1 nT."""
_EARTH = QUANTITIES["magnetic_field"]


def magnetic(scenario: Scenario) -> Adapter:
    """Return the adapter of the field magnetic."""
    if scenario.magnetometer.online:
        from isogal_ros.messages.magnetic_terms import MagneticTermsAdapter

        return MagneticTermsAdapter()
    return MagnetometerAdapter()


class MagnetometerAdapter(Framed):
    """Total field and its anomaly.

    Of a raw vector only the length counts, so that its frame may be any, but for what a magnetic
    vehicle adds: that is told in the axes that the messages have. The simulated instrument
    measures the total field alone, as optically pumped ones do: it is on z. That on a magnetic
    vehicle has a vector instrument beside it, in axes forward, right, down. The anomaly is the
    component along the main field, the other two are not reported (NaN, as the definition of the
    message has it)."""

    raw, reduced = topics.MAGNETIC_FIELD, topics.ANOMALY
    frames = MAGNETOMETER, MAIN_FIELD

    def fill_raw(self, message: Any, ns: int, value: float, variance: float) -> None:
        """Write a total field, nT."""
        self.fill_vector(message, ns, (0.0, 0.0, value), variance)

    def fill_vector(self, message: Any, ns: int, vector: Any, variance: float) -> None:
        """Write a vector (3,), nT, with the variance of each component."""
        set_stamp(message.header.stamp, ns)
        field = message.magnetic_field
        field.x, field.y, field.z = (float(part) * TESLA for part in vector)
        message.magnetic_field_covariance = (np.eye(3) * variance * TESLA**2).ravel()

    def read_vector(self, message: Any) -> Array:
        """Return a vector (3,), nT."""
        field = message.magnetic_field
        vector = np.array([field.x, field.y, field.z]) / TESLA
        if not np.isfinite(vector).all():
            raise BadMessageError("a component is not finite: the field needs all three")
        return vector

    def read_scalar(self, message: Any) -> tuple[float, float | None]:
        """Return total field and variance of a scalar instrument's message, see `read_raw`: it is
        on z, the other components are zero or not finite."""
        field = message.magnetic_field
        total, variance = field.z / TESLA, float(message.magnetic_field_covariance[8]) / TESLA**2
        if math.isfinite(field.x) and math.isfinite(field.y):
            total = math.sqrt(field.x**2 + field.y**2 + field.z**2) / TESLA
        _require_earths(total)
        if not variance >= 0.0 or math.isinf(variance):
            raise BadMessageError("negative variance")
        return total, variance or None

    def read_raw(self, message: Any) -> tuple[float, float | None]:
        """Return the total field (nT) and its variance (nT²), that of the component along the
        vector; None = unknown (zero)."""
        vector = self.read_vector(message)
        covariance = np.asarray(message.magnetic_field_covariance).reshape(3, 3) / TESLA**2
        total = math.sqrt(vector @ vector)
        _require_earths(total)
        require_covariance(covariance)
        variance = float(vector @ covariance @ vector) / total**2
        if variance < 0.0:
            raise BadMessageError("negative variance")
        return total, variance or None

    def new_reduced(self) -> Any:
        """Return a message with nothing across the main field."""
        message = super().new_reduced()
        message.magnetic_field.x = message.magnetic_field.y = math.nan
        return message

    def fill_reduced(
        self, message: Any, ns: int, value: float, variance: float, place: Place
    ) -> None:
        """Write an anomaly, nT."""
        set_stamp(message.header.stamp, ns)
        message.magnetic_field.z = value * TESLA
        covariance = np.zeros(9)
        covariance[8] = variance * TESLA**2
        message.magnetic_field_covariance = covariance

    def read_reduced(self, message: Any) -> tuple[float, float]:
        """Return the anomaly (nT) and its variance (nT²)."""
        value = message.magnetic_field.z / TESLA
        variance = float(message.magnetic_field_covariance[8]) / TESLA**2
        require_reading(value, variance)
        return value, variance


def _require_earths(total: float) -> None:
    """Raise BadMessageError unless a total field, nT, may be the Earth's."""
    if not _EARTH.lowest <= total <= _EARTH.highest:
        raise BadMessageError(
            f"a total field of {total * TESLA:.3g} T is not the Earth's; the unit is tesla"
        )
