"""A magnetometer's reading with the terms of what its vehicle adds, whose coefficients the matcher
estimates: a point (`isogal_ros.messages.point`) with the fields `anomaly` (nT), `variance` (nT²)
and `terms`, in the order of `isogal.magnetics.terms` (docs/magnetometer.md, section 2)."""

from typing import Any

import numpy as np

from isogal.magnetics.terms import COUNT
from isogal_ros import topics
from isogal_ros.messages.adapter import Place
from isogal_ros.messages.checks import BadMessageError, require_frame, require_reading
from isogal_ros.messages.frames import framed
from isogal_ros.messages.magnetometer import MAIN_FIELD, MagnetometerAdapter
from isogal_ros.messages.point import fill_point, numbers, read_point

FIELDS = ("anomaly", "variance", "terms")


class MagneticTermsAdapter(MagnetometerAdapter):
    """Total field; and its anomaly with the terms, readings of (1 + C,) numbers."""

    reduced = topics.TERMS

    def new_reduced(self) -> Any:
        """Return a message to be filled."""
        return framed(self.reduced, MAIN_FIELD)

    def fill_reduced(
        self, message: Any, ns: int, value: Any, variance: float, place: Place
    ) -> None:
        """Write an anomaly, nT, and its terms (1 + C,); NaN = none."""
        found = np.broadcast_to(value, COUNT + 1)
        content = found[0], variance, found[1:]
        fill_point(message, ns, dict(zip(FIELDS, content, strict=True)))

    def read_reduced(self, message: Any) -> tuple[Any, float]:
        """Return the anomaly with its terms (1 + C,), and its variance (nT²)."""
        require_frame(message, MAIN_FIELD)
        content = read_point(message)
        anomaly, variance = (float(numbers(content, name, 1)[0]) for name in FIELDS[:2])
        require_reading(anomaly, variance)
        terms = numbers(content, FIELDS[2], COUNT)
        if not np.isfinite(terms).all():
            raise BadMessageError("a term is not finite")
        return np.concatenate([[anomaly], terms]), variance
