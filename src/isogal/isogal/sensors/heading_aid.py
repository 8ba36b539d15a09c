"""A simulated sensor of the heading, and magnetic declination (docs/mathematics.md, section
3.16)."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from isogal.inertial.rotations import matrix
from isogal.scenario import HeadingAid
from isogal.seeds import generator
from isogal.sensors.magnetometer import field_vector
from isogal.sensors.noise import Noise
from isogal.sensors.position_aid import AidReadings, aid_index, within
from isogal.sensors.trajectory import Trajectory

_CELL = 0.5
"""deg between the points at which the main field is computed; between them it is linear."""


def simulate_headings(
    aid: HeadingAid, trajectory: Trajectory, seed: int, runs: Sequence[int], epoch: float
) -> AidReadings:
    """Return the headings (R, M), rad from north, magnetic north of an epoch (decimal year) for a
    compass, that an aid as it really is gives in some runs."""
    index = aid_index(aid.interval, trajectory)
    ahead = matrix(trajectory.attitude[index])[:, :, 0]
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    if aid.kind == "compass":
        heading = heading - [
            declination(latitude, longitude, epoch)
            for latitude, longitude in zip(
                trajectory.latitude[index].tolist(),
                trajectory.longitude[index].tolist(),
                strict=True,
            )
        ]
    errors = Noise(
        aid.prefix,
        aid.number("sigma"),
        correlated=aid.number("correlated_sigma"),
        correlation_time=aid.correlation_time,
    )
    time = trajectory.time[index] - trajectory.time[0]
    found = np.empty((len(runs), len(index)))
    for k, run in enumerate(runs):
        mounting = generator(seed, run, f"{aid.prefix}_mounting").standard_normal()
        found[k] = heading + errors.draw(seed, run, time) + aid.number("bias") * mounting
    seen = within(aid.available, time)
    if aid.kind == "course":
        seen &= np.hypot(*trajectory.velocity[index, :2].T) >= aid.slowest
    found[:, ~seen] = np.nan
    return AidReadings(index, np.remainder(found + math.pi, 2.0 * math.pi) - math.pi)


def declination(latitude: float, longitude: float, epoch: float) -> float:
    """Return the declination of the main field (IGRF) at sea level, rad, positive to the east.

    At the poles of the field, where a compass shows nothing, it is as it comes.

    Parameters
    ----------
    latitude, longitude : float
        rad.
    epoch : float
        Decimal year, 1900 to 2030.
    """
    place = math.degrees(latitude) / _CELL, math.degrees(longitude) / _CELL
    (south, north_share), (west, east_share) = (
        (math.floor(one), one - math.floor(one)) for one in place
    )
    field = np.zeros(2)
    for i, by_north in ((0, 1.0 - north_share), (1, north_share)):
        for j, by_east in ((0, 1.0 - east_share), (1, east_share)):
            field += by_north * by_east * np.array(_horizontal(south + i, west + j, epoch))
    return math.atan2(field[1], field[0])


@lru_cache(maxsize=4096)
def _horizontal(row: int, column: int, epoch: float) -> tuple[float, float]:
    """Return the main field to the north and east (nT) at a point of the grid."""
    # at the pole itself north is no direction: next to it
    latitude = max(-89.99, min(89.99, row * _CELL))
    north, east, _ = field_vector([latitude], [column * _CELL % 360.0], 0.0, epoch)[0].tolist()
    return north, east
