"""Named numbers as a PointCloud2 of one point: a message with a stamp that describes its own
content."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from sensor_msgs.msg import PointField

from isogal.arrays import Array
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamps import set_stamp

_MOST_FIELDS = 64


def fill_point(message: Any, ns: int, values: Mapping[str, Array | float]) -> None:
    """Write a stamp and named numbers, all float64; arrays row by row."""
    arrays = {name: np.atleast_1d(np.asarray(value, "<f8")) for name, value in values.items()}
    offset, fields = 0, []
    for name, array in arrays.items():
        fields.append(
            PointField(name=name, offset=offset, datatype=PointField.FLOAT64, count=array.size)
        )
        offset += array.nbytes
    set_stamp(message.header.stamp, ns)
    message.height = message.width = 1
    message.is_bigendian = False
    message.is_dense = all(bool(np.isfinite(array).all()) for array in arrays.values())
    message.point_step = message.row_step = offset
    message.fields = fields
    message.data = b"".join(array.tobytes() for array in arrays.values())


def read_point(message: Any) -> dict[str, Array]:
    """Return the numbers of a point by the name of their field, each as an array (N,).

    Raises
    ------
    BadMessageError
        There is not one point, a field is not of float64, or it lies beyond the data.
    """
    if message.width * message.height != 1:
        raise BadMessageError(f"must hold one point, holds {message.width * message.height}")
    if len(message.fields) > _MOST_FIELDS:
        raise BadMessageError(f"has more than {_MOST_FIELDS} fields")
    data, number = bytes(message.data), np.dtype(">f8" if message.is_bigendian else "<f8")
    values = {}
    for item in message.fields:
        if item.datatype != PointField.FLOAT64 or item.count < 1:
            raise BadMessageError(f"field {item.name} must be float64")
        if item.offset + 8 * item.count > min(message.point_step, len(data)):
            raise BadMessageError(f"field {item.name} lies beyond the end of the data")
        numbers = np.frombuffer(data, number, item.count, item.offset)
        values[item.name] = numbers.astype(np.float64)
    return values
