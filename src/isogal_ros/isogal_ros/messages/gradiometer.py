"""Components of the gravity gradient tensor as messages.

No standard message holds a tensor. A PointCloud2 has a stamp and describes its own content: a
reading is one point with a field for each component (T_nn, T_ne, T_nd, T_ee, T_ed, T_dd; 1/s²) and
the field `covariance` of C x C numbers, row by row in the order of those fields. Numbers are found
by name, so that components may be left out and none is put where another quantity is meant."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from isogal.arrays import Array
from isogal.maps.quantities import QUANTITIES
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.adapter import Place
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_frame
from isogal_ros.messages.stamps import set_stamp

GRADIOMETER = "gradiometer_link"
"""Frame of a level platform that points north: x north, y east, z down, as the components are
named."""
PREFIX, COVARIANCE = "T_", "covariance"
_LARGEST = 2.0 * QUANTITIES["gradient"].highest
"""1/s²: the normal gradient's 3.1e-6 and what the Earth's crust adds."""


def gradient(scenario: Scenario) -> "GradiometerAdapter":
    """Return the adapter of the field gradient."""
    return GradiometerAdapter(scenario.gradiometer.components)


class GradiometerAdapter:
    """Gradient of gravity and of the disturbing potential, some components of each.

    Parameters
    ----------
    components : sequence of str
        Of `scenario.TENSOR_COMPONENTS`; readings are in their order, whatever the order in a
        message.
    """

    raw, reduced = topics.FULL_GRADIENT, topics.GRADIENT

    def __init__(self, components: Sequence[str]) -> None:
        self._names = [PREFIX + name for name in components]
        count = len(self._names)
        self._kind = np.dtype(
            [*((name, "<f8") for name in self._names), (COVARIANCE, "<f8", (count, count))]
        )

    def new_raw(self) -> Any:
        """Return a message of one point."""
        size = self._kind.itemsize
        message = PointCloud2(
            height=1, width=1, is_bigendian=False, point_step=size, row_step=size, is_dense=True
        )
        message.header.frame_id = GRADIOMETER
        places = {name: 8 * i for i, name in enumerate((*self._names, COVARIANCE))}
        message.fields = [
            PointField(
                name=name,
                offset=place,
                datatype=PointField.FLOAT64,
                count=math.prod(self._kind[name].shape),
            )
            for name, place in places.items()
        ]
        return message

    def fill_raw(self, message: Any, ns: int, value: Array, variance: Array) -> None:
        """Write a gradient felt (C,), 1/s², and its covariance (C, C)."""
        point = np.zeros(1, self._kind)
        for name, component in zip(
            self._names, np.broadcast_to(value, len(self._names)), strict=True
        ):
            point[name] = component
        point[COVARIANCE] = variance
        set_stamp(message.header.stamp, ns)
        message.is_dense = bool(np.isfinite(value).all())
        message.data = point.tobytes()

    def new_reduced(self) -> Any:
        """Return a message of one point."""
        return self.new_raw()

    def fill_reduced(
        self, message: Any, ns: int, value: Array, variance: Array, place: Place
    ) -> None:
        """Write a gradient of the disturbing potential (C,), 1/s², and its covariance (C, C)."""
        self.fill_raw(message, ns, value, variance)

    def read_raw(self, message: Any) -> tuple[Array, Array | None]:
        """Return the gradient felt (C,), NaN = no reading of that component, and its covariance;
        None = unknown (zero)."""
        value, covariance = self.read_reduced(message)
        return value, covariance if covariance.any() else None

    def read_reduced(self, message: Any) -> tuple[Array, Array]:
        """Return the gradient (C,), NaN = no reading of that component, and its covariance."""
        require_frame(message, GRADIOMETER)
        there, order = self._layout(message)
        data, number = bytes(message.data), np.dtype(">f8" if message.is_bigendian else "<f8")

        def numbers(name: str) -> Array:
            field = there[name]
            return np.frombuffer(data, number, field.count, field.offset).astype(np.float64)

        rows = [order.index(name) for name in self._names]
        value = np.concatenate([numbers(name) for name in self._names])
        covariance = numbers(COVARIANCE).reshape(len(order), len(order))[np.ix_(rows, rows)]
        if np.isinf(value).any() or np.nanmax(np.abs(value), initial=0.0) > _LARGEST:
            raise BadMessageError(
                f"a component above {_LARGEST:g} 1/s² is not the Earth's; the unit is 1/s²"
            )
        require_covariance(covariance)
        return value, covariance

    def _layout(self, message: Any) -> tuple[dict[str, Any], list[str]]:
        """Return (fields by name, names of the components in the order of the covariance's rows);
        raises BadMessageError where the message does not hold what is needed."""
        there = {field.name: field for field in message.fields}
        order = [field.name for field in message.fields if field.name.startswith(PREFIX)]
        missing = [name for name in (*self._names, COVARIANCE) if name not in there]
        if missing:
            raise BadMessageError(
                f"no field {missing[0]}; fields are {', '.join(there) or '(none)'}"
            )
        counts = dict.fromkeys(order, 1) | {COVARIANCE: len(order) ** 2}
        for name, count in counts.items():
            field = there[name]
            if field.datatype != PointField.FLOAT64 or field.count != count:
                raise BadMessageError(f"field {name} must be {count} x float64")
            if field.offset + 8 * count > min(message.point_step, len(message.data)):
                raise BadMessageError(f"field {name} lies beyond the end of the data")
        if message.width * message.height != 1:
            raise BadMessageError(f"must hold one point, holds {message.width * message.height}")
        return there, order
