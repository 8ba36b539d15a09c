"""Scans that have been collected and wait to become a batch."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.residual_gravity import ResidualGravity
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
    gravity: ResidualGravity | None = None
    """None = what the builder assumes anyway."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """What is known of scans at the end of a batch: the correction by its fix needs it again."""

    latitude: Array
    """(T,) rad."""
    longitude: Array
    """(T,) rad."""
    velocity: Array
    """(T, 2) m/s."""
    every: Array
    """(T, 7, 7) errors at the scans per unit of error at the end."""
    jacobian: Array
    """(T, 4) of the reduction."""
    scans: list[Scan]
    end: float
    """s."""
    bridge: Bridge | None = None

    def is_of(self, scans: list[Scan], end: float, bridge: Bridge | None) -> bool:
        """Whether it is of these scans, unmoved since, and this end."""
        same = len(scans) == len(self.scans) and scans[-1] is self.scans[-1]
        return same and end == self.end and bridge is self.bridge

    def move(self, jump: Array) -> None:
        """Carry a jump (7,) of the navigator at the end back to the scans."""
        shift = (self.every @ jump)[:, :4]
        change = (self.jacobian * shift).sum(axis=1)
        north, east = metres_per_radian(self.latitude)
        latitude, longitude = self.latitude + shift[:, 0] / north, self.longitude
        places = np.stack([latitude, longitude + shift[:, 1] / east], axis=1)
        velocity = self.velocity + shift[:, 2:]
        for i, (scan, place, more) in enumerate(
            zip(self.scans, places.tolist(), change.tolist(), strict=True)
        ):
            scan.latitude, scan.longitude = place
            scan.velocity, scan.reading = velocity[i], scan.reading + more


def arrays_of(scans: list[Scan]) -> tuple[Array, Array, Array, Array]:
    """Return latitudes and longitudes (T,), velocities (T, 2) and times (T,) of scans."""
    return (
        np.array([scan.latitude for scan in scans]),
        np.array([scan.longitude for scan in scans]),
        np.concatenate([scan.velocity for scan in scans]).reshape(-1, 2),
        np.array([scan.time for scan in scans]),
    )
