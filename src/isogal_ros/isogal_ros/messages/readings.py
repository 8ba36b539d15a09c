"""Readings as messages: what each instrument publishes raw, and what is published of it once it is
reduced.

Values and variances are in the unit of the field's maps (m/s², nT, m, 1/s²); messages have those
of their definitions (m/s², T, m). A reading of several channels is an array (C,) with a covariance
(C, C) instead of a number and its variance. Readers raise `BadMessageError` for what cannot be
used."""

import math
from typing import Any, Protocol

import numpy as np
from sensor_msgs.msg import NavSatStatus

from isogal.maps.quantities import QUANTITIES
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.convert import NOT_MEASURED, PLATFORM, fill_accel, fill_fix, read_accel
from isogal_ros.messages.gradiometer import GradiometerAdapter
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.nodes.health import BadMessageError
from isogal_ros.topics import Topic

MAGNETOMETER, ALTIMETER, MAIN_FIELD, GROUND = (
    "magnetometer_link",
    "altimeter_link",
    "main_field",
    "ground",
)
"""Frame names. `main_field` has its z axis along the main field, the direction in which an anomaly
counts."""
TESLA = 1e-9
"""T in 1 nT."""
_EARTH = QUANTITIES["magnetic_field"]

Place = tuple[float, float] | None
"""Latitude and longitude (rad) where the navigator took a reading to be; None = not known."""


class Adapter(Protocol):
    """Messages of one field."""

    raw: Topic
    reduced: Topic

    def new_raw(self, scenario: Scenario) -> Any:
        """Return a raw message of the simulated instrument, to be filled."""
        ...

    def fill_raw(self, message: Any, ns: int, value: Any, variance: Any) -> None:
        """Write what is felt (NaN = nothing in range) into a raw message."""
        ...

    def read_raw(self, message: Any) -> tuple[Any, Any | None]:
        """Return (what was felt, NaN = nothing in range; its variance, None = unknown)."""
        ...

    def new_reduced(self) -> Any:
        """Return a message for reduced readings, to be filled."""
        ...

    def fill_reduced(self, message: Any, ns: int, value: Any, variance: Any, place: Place) -> None:
        """Write a reduced reading (NaN = none) into its message."""
        ...

    def read_reduced(self, message: Any) -> tuple[Any, Any]:
        """Return (reduced reading, NaN = the instrument had none in range; variance)."""
        ...


class GravimeterAdapter:
    """AccelWithCovarianceStamped, z up, on a level platform."""

    raw = topics.FELT

    def __init__(self, reduced: Topic) -> None:
        self.reduced = reduced

    def new_raw(self, scenario: Scenario) -> Any:
        """Return a message in the platform's frame."""
        return self.new_reduced()

    def fill_raw(self, message: Any, ns: int, value: float, variance: float) -> None:
        """Write felt gravity, m/s²."""
        fill_accel(message, ns, value, variance)

    def read_raw(self, message: Any) -> tuple[float, float | None]:
        """Return felt gravity and its variance."""
        return read_accel(message)

    def new_reduced(self) -> Any:
        """Return a message in the platform's frame."""
        message = topics.FELT.type()
        message.header.frame_id = PLATFORM
        return message

    def fill_reduced(
        self, message: Any, ns: int, value: float, variance: float, place: Place
    ) -> None:
        """Write gravity or the disturbance, m/s²."""
        fill_accel(message, ns, value, variance)

    def read_reduced(self, message: Any) -> tuple[float, float]:
        """Return gravity or the disturbance and its variance."""
        return read_accel(message)


class MagnetometerAdapter:
    """MagneticField in tesla. Of the raw vector only the length is used, so that its frame may be
    any.

    The simulated instrument measures the total field alone, as optically pumped ones do: it stands
    on z. The anomaly is the component along the main field, the other two are not reported (NaN,
    as the message's definition has it)."""

    raw, reduced = topics.MAGNETIC_FIELD, topics.ANOMALY

    def new_raw(self, scenario: Scenario) -> Any:
        """Return a message in the magnetometer's frame."""
        message = self.raw.type()
        message.header.frame_id = MAGNETOMETER
        return message

    def fill_raw(self, message: Any, ns: int, value: float, variance: float) -> None:
        """Write a total field, nT."""
        set_stamp(message.header.stamp, ns)
        message.magnetic_field.z = value * TESLA
        message.magnetic_field_covariance = (np.eye(3) * variance * TESLA**2).ravel()

    def read_raw(self, message: Any) -> tuple[float, float | None]:
        """Return the total field (nT) and its variance (nT²): that of the component along the
        vector."""
        vector = (
            np.array(
                [message.magnetic_field.x, message.magnetic_field.y, message.magnetic_field.z]
            )
            / TESLA
        )
        covariance = np.asarray(message.magnetic_field_covariance).reshape(3, 3) / TESLA**2
        if not np.isfinite(vector).all():
            raise BadMessageError("a component is not finite: the total field needs all three")
        total = math.sqrt(vector @ vector)
        if not _EARTH.lowest <= total <= _EARTH.highest:
            raise BadMessageError(
                f"a total field of {total * TESLA:.3g} T is not the Earth's; the unit is tesla"
            )
        if not np.isfinite(covariance).all():
            raise BadMessageError("covariance is not finite")
        variance = float(vector @ covariance @ vector) / total**2
        if variance < 0.0 or (np.diag(covariance) < 0.0).any():
            raise BadMessageError("negative variance")
        return total, variance or None

    def new_reduced(self) -> Any:
        """Return a message with nothing across the main field."""
        message = self.reduced.type()
        message.header.frame_id = MAIN_FIELD
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
        value, variance = (
            message.magnetic_field.z / TESLA,
            float(message.magnetic_field_covariance[8]) / TESLA**2,
        )
        if not (math.isfinite(value) and math.isfinite(variance)):
            raise BadMessageError("reading is not finite")
        if variance < 0.0:
            raise BadMessageError("negative variance")
        return value, variance


class AltimeterAdapter:
    """Range of an instrument that looks straight down; terrain height as NavSatFix: the point on
    the ground below."""

    raw, reduced = topics.CLEARANCE, topics.TERRAIN

    def new_raw(self, scenario: Scenario) -> Any:
        """Return a message with the scenario's limits of range."""
        message = self.raw.type()
        message.header.frame_id = ALTIMETER
        message.min_range, message.max_range = (
            scenario.altimeter.min_range,
            scenario.altimeter.max_range,
        )
        return message

    def fill_raw(self, message: Any, ns: int, value: float, variance: float) -> None:
        """Write a clearance, m; NaN becomes infinity, which is what REP 117 has for nothing in
        range."""
        set_stamp(message.header.stamp, ns)
        message.range = math.inf if math.isnan(value) else value
        message.variance = variance

    def read_raw(self, message: Any) -> tuple[float, float | None]:
        """Return the clearance (m), NaN where it is out of range, and its variance."""
        low, high, value, variance = (
            message.min_range,
            message.max_range,
            message.range,
            message.variance,
        )
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

    def new_reduced(self) -> Any:
        """Return a message of a point below the vehicle."""
        message = self.reduced.type()
        message.header.frame_id = GROUND
        return message

    def fill_reduced(
        self, message: Any, ns: int, value: float, variance: float, place: Place
    ) -> None:
        """Write a terrain height, m; NaN = no altitude, as the message's definition has it."""
        code = NavSatStatus.STATUS_NO_FIX if math.isnan(value) else NavSatStatus.STATUS_FIX
        covariance = np.diag([NOT_MEASURED, NOT_MEASURED, variance])
        fill_fix(message, ns, *(place or (math.nan, math.nan)), value, covariance, code)

    def read_reduced(self, message: Any) -> tuple[float, float]:
        """Return the terrain height (m) and its variance (m²)."""
        value, variance = message.altitude, float(message.position_covariance[8])
        none = message.status.status == NavSatStatus.STATUS_NO_FIX and math.isnan(value)
        if not (math.isfinite(value) or none) or not math.isfinite(variance):
            raise BadMessageError("reading is not finite")
        if variance < 0.0:
            raise BadMessageError("negative variance")
        return value, variance


ADAPTERS: dict[str, Any] = {
    "gravity": GravimeterAdapter(topics.GRAVITY),
    "disturbance": GravimeterAdapter(topics.DISTURBANCE),
    "magnetic": MagnetometerAdapter(),
    "terrain": AltimeterAdapter(),
    "gradient": GradiometerAdapter(),
}
"""By name of the field (`isogal.fields.measured.FIELDS`)."""


def adapter_of(scenario: Scenario, field: str | None = None) -> Adapter:
    """Return the adapter of a field, by default the scenario's own, as the scenario's instrument
    needs it."""
    adapter: Adapter = ADAPTERS[field or scenario.measured_field]
    return (
        GradiometerAdapter(scenario.gradiometer.components)
        if isinstance(adapter, GradiometerAdapter)
        else adapter
    )
