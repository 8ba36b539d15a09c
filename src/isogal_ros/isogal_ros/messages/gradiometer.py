"""Components of the gravity gradient tensor as messages.

No standard message is of a tensor. A PointCloud2 is stamped and says itself what it holds: a
reading is one point of as many dimensions as there are components, each a field by its name (T_nn,
T_ne, T_nd, T_ee, T_ed, T_dd; 1/s²), and `covariance`, a field of C x C numbers, row by row in the
order of those fields. Nothing has to stand in a place that means something else, and components
may be left out."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from isogal.arrays import Array
from isogal.maps.quantities import QUANTITIES
from isogal.scenario import TENSOR_COMPONENTS, Scenario
from isogal_ros import topics
from isogal_ros.messages.convert import require_frame
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.nodes.health import BadMessageError

GRADIOMETER = "gradiometer_link"
"""Frame of a level platform that points north: x north, y east, z down, as the components are
named."""
PREFIX, COVARIANCE = "T_", "covariance"
_LARGEST = 2.0 * QUANTITIES["gradient"].highest
"""1/s²: the normal gradient's 3.1e-6 and what the Earth's crust adds."""


class GradiometerAdapter:
    """Both messages of a gradiometer with some components, see the module.

    Parameters
    ----------
    components : sequence of str
        Of `scenario.TENSOR_COMPONENTS`; readings are in their order, whatever the order in a
        message.
    """

    raw, reduced = topics.FULL_GRADIENT, topics.GRADIENT

    def __init__(self, components: Sequence[str] = TENSOR_COMPONENTS[:5]) -> None:
        self.components = tuple(components)
        self._names = [PREFIX + name for name in components]
        count = len(self._names)
        self._kind = np.dtype(
            [*((name, "<f8") for name in self._names), (COVARIANCE, "<f8", (count, count))]
        )

    def new_raw(self, scenario: Scenario) -> Any:
        """Return a message of one point."""
        return self.new_reduced()

    def new_reduced(self) -> Any:
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

    def fill_reduced(
        self, message: Any, ns: int, value: Array, variance: Array, place: Any
    ) -> None:
        """Write a gradient of the disturbing potential (C,), 1/s², and its covariance (C, C)."""
        self.fill_raw(message, ns, value, variance)

    def read_raw(self, message: Any) -> tuple[Array, Array | None]:
        """Return the gradient felt (C,), NaN = no reading of that component, and its covariance;
        None = unknown (zero)."""
        value, covariance = self._read(message)
        return value, covariance if covariance.any() else None

    def read_reduced(self, message: Any) -> tuple[Array, Array]:
        """Return the gradient (C,), NaN = no reading of that component, and its covariance."""
        return self._read(message)

    def _read(self, message: Any) -> tuple[Array, Array]:
        require_frame(message, GRADIOMETER)
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
        data, number = bytes(message.data), np.dtype(">f8" if message.is_bigendian else "<f8")

        def numbers(name: str) -> Array:
            return np.frombuffer(data, number, counts[name], there[name].offset).astype(np.float64)

        rows = [order.index(name) for name in self._names]
        value = np.concatenate([numbers(name) for name in self._names])
        covariance = numbers(COVARIANCE).reshape(len(order), len(order))[np.ix_(rows, rows)]
        if np.isinf(value).any() or np.nanmax(np.abs(value), initial=0.0) > _LARGEST:
            raise BadMessageError(
                f"a component above {_LARGEST:g} 1/s² is not the Earth's; the unit is 1/s²"
            )
        if not np.isfinite(covariance).all():
            raise BadMessageError("covariance is not finite")
        if (np.diag(covariance) < 0.0).any():
            raise BadMessageError("negative variance")
        return value, covariance
