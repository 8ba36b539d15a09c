"""Candidates of a matcher as PointCloud2 messages: points with the fields latitude, longitude
(deg), weight and scan, in the frame ``wgs84``."""

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from isogal.matching.interfaces import Candidates
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import GEODETIC
from isogal_ros.messages.stamps import set_stamp

_POINT = np.dtype([("latitude", "<f8"), ("longitude", "<f8"), ("weight", "<f8"), ("scan", "<u4")])
_TYPES = {"<f8": PointField.FLOAT64, "<u4": PointField.UINT32}


def candidates_cloud(ns: int, candidates: Candidates | None) -> PointCloud2:
    """Return a message of candidates; of no point where there are none."""
    count = 0 if candidates is None else len(candidates.latitude)
    points = np.zeros(count, dtype=_POINT)
    if candidates is not None:
        points["latitude"] = np.degrees(candidates.latitude)
        points["longitude"] = np.degrees(candidates.longitude)
        points["weight"], points["scan"] = candidates.weight, candidates.scan
    cloud = PointCloud2(
        height=1,
        width=count,
        is_bigendian=False,
        point_step=_POINT.itemsize,
        row_step=count * _POINT.itemsize,
        is_dense=True,
    )
    set_stamp(cloud.header.stamp, ns)
    cloud.header.frame_id = GEODETIC
    cloud.fields = [
        PointField(name=name, offset=offset, datatype=_TYPES[kind.str], count=1)
        for name, (kind, offset, *_) in (_POINT.fields or {}).items()
    ]
    cloud.data = points.tobytes()
    return cloud


def read_candidates(cloud: PointCloud2) -> Candidates:
    """Return the candidates of a cloud that `candidates_cloud` made; raises BadMessageError where
    the fields are others."""
    names = [field.name for field in cloud.fields]
    if cloud.point_step != _POINT.itemsize or names != list(_POINT.names or ()):
        raise BadMessageError("fields must be latitude, longitude, weight, scan")
    points = np.frombuffer(bytes(cloud.data), dtype=_POINT)
    return Candidates(
        np.radians(points["latitude"]),
        np.radians(points["longitude"]),
        points["weight"].copy(),
        points["scan"].astype(np.int64),
    )
