"""Named numbers as a PointCloud2: a message with a stamp that describes its own content. What no
standard message holds is one point, whose fields are arrays of float64."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import PointCloud2, PointField

from isogal.arrays import Array
from isogal.matching.interfaces import Candidates
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import GEODETIC, framed
from isogal_ros.messages.stamps import set_stamp

_KINDS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8", PointField.UINT32: "u4"}
_NAMES = {"f4": "float32", "f8": "float64", "u4": "uint32"}


def fill_cloud(
    message: PointCloud2, ns: int, columns: Mapping[str, NDArray[np.generic]]
) -> PointCloud2:
    """Write a stamp and points, whose numbers are given by the name of their field: arrays (N,) or
    (N, C), of which those of float32, float64 and uint32 stay so. Return the message."""
    count = len(next(iter(columns.values()), (None,)))
    arrays = {name: column.reshape(count, -1 if count else 1) for name, column in columns.items()}
    kind = np.dtype([(name, f"<{a.dtype.str[1:]}", a.shape[1:]) for name, a in arrays.items()])
    points = np.empty(count, kind)
    types = {short: datatype for datatype, short in _KINDS.items()}
    message.fields = [
        PointField(
            name=name,
            offset=kind.fields[name][1] if kind.fields else 0,
            datatype=types[array.dtype.str[1:]],
            count=array.shape[1],
        )
        for name, array in arrays.items()
    ]
    for name, array in arrays.items():
        points[name] = array
    set_stamp(message.header.stamp, ns)
    message.height, message.width, message.is_bigendian = 1, count, False
    message.is_dense = all(bool(np.isfinite(array).all()) for array in arrays.values())
    message.point_step, message.row_step = kind.itemsize, points.nbytes
    message.data = points.tobytes()
    return message


def fill_point(message: PointCloud2, ns: int, values: Mapping[str, ArrayLike]) -> PointCloud2:
    """Write a stamp and named numbers as one point, all float64; arrays row by row. Return the
    message."""
    rows = {name: np.asarray(value, np.float64).reshape(1, -1) for name, value in values.items()}
    return fill_cloud(message, ns, rows)


def read_cloud(
    message: PointCloud2,
    wanted: Callable[[str], bool],
    kinds: tuple[str, ...] = ("f4", "f8", "u4"),
) -> dict[str, Array]:
    """Return the numbers of points by the name of their field, arrays (N, C).

    Parameters
    ----------
    wanted : callable
        Whether a field of a name is; the others may hold anything.
    kinds : tuple of str
        Types that numbers may have.

    Raises
    ------
    BadMessageError
        A field is of another type or lies beyond the data.
    """
    found = {item.name: item for item in message.fields if wanted(item.name)}
    for item in found.values():
        if _KINDS.get(item.datatype) not in kinds:
            allowed = " or ".join(_NAMES[one] for one in kinds)
            raise BadMessageError(f"field {item.name} must be {allowed}")
    if not found:
        return {}
    order, each = ">" if message.is_bigendian else "<", found.values()
    formats = [(f"{order}{_KINDS[item.datatype]}", (item.count,)) for item in each]
    offsets, step = [item.offset for item in each], message.point_step
    try:
        whole = np.dtype(
            {"names": list(found), "formats": formats, "offsets": offsets, "itemsize": step}
        )
        points = np.frombuffer(bytes(message.data), whole, message.width * message.height)
    except (ValueError, OverflowError):
        raise BadMessageError("a field or a point lies beyond the end of the data") from None
    return {name: np.asarray(points[name], np.float64) for name in found}


def read_point(
    message: PointCloud2, wanted: Callable[[str], bool] = lambda name: True
) -> dict[str, Array]:
    """Return the numbers of one point by the name of their field, each as an array (N,).

    Raises
    ------
    BadMessageError
        There is not one point, a field is not of float64, or it lies beyond the data.
    """
    if message.width * message.height != 1:
        raise BadMessageError(f"must hold one point, holds {message.width * message.height}")
    return {name: rows[0] for name, rows in read_cloud(message, wanted, ("f8",)).items()}


def numbers(values: Mapping[str, Array], name: str, *shape: int, finite: bool = True) -> Array:
    """Return the numbers of a field in a shape; raises BadMessageError where it is missing, of
    another size or, unless it may be, not finite."""
    if name not in values:
        raise BadMessageError(f"no field {name}; fields are {', '.join(values) or '(none)'}")
    size = math.prod(shape)
    if len(values[name]) != size:
        raise BadMessageError(f"field {name} must be {size} x float64, has {len(values[name])}")
    if finite and not np.isfinite(values[name]).all():
        raise BadMessageError(f"field {name} is not finite")
    return values[name].reshape(shape)


def number(values: Mapping[str, Array], name: str) -> float:
    """Return the only number of a field; raises as `numbers`."""
    return float(numbers(values, name))


FIELDS = ("latitude", "longitude", "weight", "scan")


def candidates_cloud(ns: int, candidates: Candidates | None) -> PointCloud2:
    """Return a message of candidates; of no point where there are none."""
    cloud = framed(topics.CANDIDATES, GEODETIC)
    columns = [np.zeros(0)] * 3 + [np.zeros(0, np.uint32)]
    if candidates is not None:
        degrees = np.degrees(candidates.latitude), np.degrees(candidates.longitude)
        columns = [*degrees, candidates.weight, candidates.scan.astype(np.uint32)]
    fill_cloud(cloud, ns, dict(zip(FIELDS, columns, strict=True)))
    return cloud


def read_candidates(cloud: PointCloud2) -> Candidates:
    """Return the candidates of a cloud that `candidates_cloud` made; raises BadMessageError where
    the fields are others."""
    if [field.name for field in cloud.fields] != list(FIELDS):
        raise BadMessageError("fields must be latitude, longitude, weight, scan")
    found = read_cloud(cloud, FIELDS.__contains__)
    latitude, longitude, weight, scan = (found[name][:, 0] for name in FIELDS)
    return Candidates(np.radians(latitude), np.radians(longitude), weight, scan.astype(np.int64))
