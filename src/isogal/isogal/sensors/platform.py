"""A gravimeter's platform that is not level (docs/mathematics.md, section 2.8)."""

import numpy as np

from isogal.arrays import Array
from isogal.inertial.rotations import matrix
from isogal.scenario import Gravimeter
from isogal.sensors.noise import RunScans

_GRAVITY = 9.8
"""m/s², of any place within 0.3 %."""


def levelling_error(settings: Gravimeter, scans: RunScans) -> Array:
    """Return (scans,) m/s² that the platform's tilt adds to the readings of a run.

    The tilts about north and east are Gauss-Markov processes of `platform_tilt` and
    `platform_time`. A tilted axis takes less of the vertical specific force, and some of the
    horizontal one; the latter is its mean over the scan's interval."""
    trajectory, index = scans.trajectory, scans.index
    if settings.platform_tilt == 0.0:
        return np.zeros(len(index))
    tilt, time = settings.platform_tilt, settings.platform_time
    north, east = scans.tilts("gravimeter", tilt, time, 2)
    force = np.einsum("kij,kj->ki", matrix(trajectory.attitude[1:]), trajectory.specific_force)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(force, axis=0)])
    steps = index[0]
    mean = (total[index] - total[index - steps]) / steps
    return tilted_reading(mean, north, east) + mean[:, 2]


def mean_error(settings: Gravimeter) -> float:
    """Return what the platform's tilt adds to a reading of a vehicle at constant velocity on
    average, m/s². Its 1-sigma is the same: half of g times a chi-square of two degrees of
    freedom, times the tilt's variance; it is correlated over half of the tilt's time."""
    return -_GRAVITY * settings.platform_tilt**2


def tilted_reading(force: Array, north: Array, east: Array) -> Array:
    """Return (N,) m/s² the specific force along the upward axis of a platform that is tilted by
    small angles (rad) about north and east; `force` (N, 3) is north, east, down."""
    # the axis is down plus (tilt x down), made a unit vector: (east, -north, 1) / length
    along = force[:, 0] * east - force[:, 1] * north + force[:, 2]
    return np.asarray(-along / np.sqrt(1.0 + north**2 + east**2))
