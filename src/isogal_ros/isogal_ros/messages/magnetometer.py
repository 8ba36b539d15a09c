"""Messages of a magnetometer: MagneticField, in tesla.

Of a raw vector only the length counts, so that its frame may be any, but for what a magnetic
vehicle adds: that is in the axes that the messages have. The simulated instrument measures
the total field alone, as optically pumped ones do: it is on z. That on a magnetic vehicle has a
vector instrument as well, in axes forward, right, down. The anomaly is the component along the
main field, the other two are not reported (NaN, as the definition of the message has it).

Where the matcher estimates what the vehicle adds, a point (`isogal_ros.messages.point`) takes the
anomaly's place, with the fields `anomaly` (nT), `variance` (nT²) and `terms`, in the order of
`isogal.magnetics.terms` (docs/magnetometer.md, section 2): readings of (1 + C,) numbers."""

import math
from collections.abc import Sequence

import numpy as np
from sensor_msgs.msg import MagneticField, PointCloud2

from isogal.arrays import Array
from isogal.magnetics.terms import COUNT
from isogal.maps.quantities import QUANTITIES
from isogal.scenario import Assumed
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, Place, Reading
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    require_reading,
)
from isogal_ros.messages.frames import framed
from isogal_ros.messages.point import fill_point, number, numbers, read_point
from isogal_ros.messages.prepared import numbers_of, write

MAGNETOMETER, MAIN_FIELD = "magnetometer_link", "main_field"
"""Frame names. `main_field` has its z axis along the main field, the direction in which an anomaly
counts."""
TESLA = 1e-9
"""T in 1 nT."""
FIELDS = ("anomaly", "variance", "terms")
_EARTH = QUANTITIES["magnetic_field"]


def magnetic(assumed: Assumed) -> Adapter:
    """Return the adapter of the field magnetic."""
    raw = topics.MAGNETIC_FIELD, _write_total, read_total
    if assumed.magnetometer.online:
        return Adapter(*raw, topics.TERMS, _write_terms, _read_terms)
    return Adapter(*raw, topics.ANOMALY, _write_anomaly, _read_anomaly)


def _write_total(ns: int, value: Reading, variance: Reading, place: Place) -> MagneticField:
    """Return a message of a total field, nT."""
    return write_vector(ns, (0.0, 0.0, float(value)), float(variance))


def write_vector(ns: int, vector: Sequence[float] | Array, variance: float) -> MagneticField:
    """Return a message of a vector (3,), nT, with the variance of each component."""
    message = framed(topics.MAGNETIC_FIELD, MAGNETOMETER)
    write(message, ns, np.array(vector) * TESLA, np.eye(3) * variance * TESLA**2)
    return message


def read_vector(message: MagneticField) -> Array:
    """Return a vector (3,), nT."""
    vector = numbers_of(message)[:3] / TESLA
    if not np.isfinite(vector).all():
        raise BadMessageError("a component is not finite: the field needs all three")
    return vector


def read_scalar(message: MagneticField) -> tuple[float, float | None]:
    """Return total field and variance of a scalar instrument's message, see `read_total`: it is on
    z, the other components are zero or not finite."""
    x, y, z = (numbers_of(message)[:3] / TESLA).tolist()
    total = math.hypot(x, y, z) if math.isfinite(x) and math.isfinite(y) else z
    variance = float(message.magnetic_field_covariance[8]) / TESLA**2
    _require_earths(total)
    require_reading(total, variance)
    return total, variance or None


def read_total(message: MagneticField) -> tuple[float, float | None]:
    """Return the total field (nT) and its variance (nT²), that of the component along the vector;
    None = unknown (zero)."""
    vector = read_vector(message)
    covariance = np.asarray(message.magnetic_field_covariance).reshape(3, 3) / TESLA**2
    total = math.sqrt(vector @ vector)
    _require_earths(total)
    require_covariance(covariance)
    variance = float(vector @ covariance @ vector) / total**2
    if variance < 0.0:
        raise BadMessageError("negative variance")
    return total, variance or None


def _write_anomaly(ns: int, value: Reading, variance: Reading, place: Place) -> MagneticField:
    """Return a message of an anomaly, nT, with nothing across the main field."""
    message = framed(topics.ANOMALY, MAIN_FIELD)
    along = np.diag([0.0, 0.0, float(variance)]) * TESLA**2
    write(message, ns, (math.nan, math.nan, float(value) * TESLA), along)
    return message


def _read_anomaly(message: MagneticField) -> tuple[float, float]:
    """Return the anomaly (nT) and its variance (nT²)."""
    value = message.magnetic_field.z / TESLA
    variance = float(message.magnetic_field_covariance[8]) / TESLA**2
    require_reading(value, variance)
    return value, variance


def _write_terms(ns: int, value: Reading, variance: Reading, place: Place) -> PointCloud2:
    """Return a message of an anomaly, nT, and its terms (1 + C,); NaN = none."""
    found = np.broadcast_to(value, COUNT + 1)
    content = dict(zip(FIELDS, (found[0], variance, found[1:]), strict=True))
    return fill_point(framed(topics.TERMS, MAIN_FIELD), ns, content)


def _read_terms(message: PointCloud2) -> tuple[Array, float]:
    """Return the anomaly with its terms (1 + C,), and its variance (nT²)."""
    require_frame(message, MAIN_FIELD)
    content = read_point(message)
    anomaly, variance = (number(content, name) for name in FIELDS[:2])
    require_reading(anomaly, variance)
    return np.concatenate([[anomaly], numbers(content, FIELDS[2], COUNT)]), variance


def _require_earths(total: float) -> None:
    """Raise BadMessageError unless a total field, nT, may be the Earth's."""
    if not _EARTH.lowest <= total <= _EARTH.highest:
        raise BadMessageError(
            f"a total field of {total * TESLA:.3g} T is not the Earth's; the unit is tesla"
        )
