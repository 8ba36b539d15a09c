"""Candidates of a matcher as PointCloud2 messages: points with the fields latitude, longitude
(deg), weight and scan, in the frame ``wgs84``."""

import numpy as np
from sensor_msgs.msg import PointCloud2

from isogal.matching.interfaces import Candidates
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import GEODETIC, framed
from isogal_ros.messages.point import fill_cloud, read_cloud

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
