"""A magnetometer's reading with the terms of what its vehicle adds, whose coefficients the matcher
estimates: a point (`isogal_ros.messages.point`) with the fields `anomaly` (nT), `variance` (nT²)
and `terms`, in the order of `isogal.magnetics.terms` (docs/magnetometer.md, section 2)."""

from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.magnetics.terms import COUNT
from isogal_ros import topics
from isogal_ros.messages.adapter import Place
from isogal_ros.messages.checks import BadMessageError, require_frame, require_reading
from isogal_ros.messages.magnetometer import MAIN_FIELD, MagnetometerAdapter
from isogal_ros.messages.point import fill_point, read_point

_FIELDS = {"anomaly": 1, "variance": 1, "terms": COUNT}


class MagneticTermsAdapter(MagnetometerAdapter):
    """Total field; and its anomaly with the terms, readings of (1 + C,) numbers."""

    reduced = topics.TERMS

    def new_reduced(self) -> Any:
        """Return a message to be filled."""
        message = self.reduced.type()
        message.header.frame_id = MAIN_FIELD
        return message

    def fill_reduced(
        self, message: Any, ns: int, value: Any, variance: float, place: Place
    ) -> None:
        """Write an anomaly, nT, and its terms (1 + C,); NaN = none."""
        found = np.broadcast_to(value, COUNT + 1)
        content = {"anomaly": found[0], "variance": variance, "terms": found[1:]}
        fill_point(message, ns, content)

    def read_reduced(self, message: Any) -> tuple[Any, float]:
        """Return the anomaly with its terms (1 + C,), and its variance (nT²)."""
        require_frame(message, MAIN_FIELD)
        content = read_point(message)
        for name, count in _FIELDS.items():
            if len(content.get(name, ())) != count:
                raise BadMessageError(f"field {name} must be {count} x float64")
        anomaly, variance = float(content["anomaly"][0]), float(content["variance"][0])
        require_reading(anomaly, variance)
        terms: Array = content["terms"]
        if not np.isfinite(terms).all():
            raise BadMessageError("a term is not finite")
        return np.concatenate([[anomaly], terms]), variance
