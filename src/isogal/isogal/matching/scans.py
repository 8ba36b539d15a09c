"""Scans that have been collected and wait to become a batch."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.matching.transitions import Bridge


@dataclass(slots=True)
class Scan:
    """One, with the navigator's estimate of where it was taken. SI units, radians."""

    time: float
    latitude: float
    longitude: float
    velocity: Array
    reading: float | Array
    sigma: float
    offset: float
    height: float
    detail: Array | None = None
    """What an `Expansion` needs beside the reading."""


@dataclass(frozen=True, slots=True, eq=False)
class Collected:
    """What a `BatchBuilder` has collected, for a checkpoint."""

    scans: tuple[Scan, ...]
    count: int
    unused: int
    bridge: Bridge | None = None


def arrays_of(scans: list[Scan]) -> tuple[Array, Array, Array, Array]:
    """Return latitudes and longitudes (T,), velocities (T, 2) and times (T,) of scans."""
    return (
        np.array([scan.latitude for scan in scans]),
        np.array([scan.longitude for scan in scans]),
        np.concatenate([scan.velocity for scan in scans]).reshape(-1, 2),
        np.array([scan.time for scan in scans]),
    )
