"""Serialised messages of tf2_msgs/TFMessage, whose class the wheels do not have."""

import struct
from collections.abc import Mapping

import numpy as np

from isogal.inertial.rotations import from_angles

Placed = tuple[str, tuple[float, float, float], tuple[float, float, float]]
"""Parent, translation (m), and roll, pitch, yaw (deg)."""


def serialised(frames: Mapping[str, Placed], order: str = "<") -> bytes:
    """Return a message of transforms by child frame, in CDR of a byte order."""
    data = bytearray(struct.pack(f"{order}I", len(frames)))

    def put(form: str, align: int, *values: float) -> None:
        data.extend(b"\0" * (-len(data) % align) + struct.pack(order + form, *values))

    for child, (parent, place, angles) in frames.items():
        put("iI", 4, 0, 0)
        for text in (parent, child):
            put("I", 4, len(text) + 1)
            data.extend(text.encode() + b"\0")
        w, x, y, z = from_angles(*np.radians(angles)).tolist()
        put("7d", 8, *place, x, y, z, w)
    return (b"\0\1\0\0" if order == "<" else b"\0\0\0\0") + bytes(data)
