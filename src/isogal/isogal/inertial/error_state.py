"""The navigator's error as a vector: which number stands where (docs/mathematics.md, sections 1.2
and 1.3).

An error is estimate minus truth; attitude errors are rotation vectors in the navigation frame. The
filter has fifteen error states. Seven of them move a position by metres within a batch: what a
batch is given as prior, what a fix informs on and what it changes are vectors of these, or of the
first four."""

from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.inertial.rotations import multiply, to_rotation_vector

FILTER_NAMES = (
    "north", "east", "down",
    "v_north", "v_east", "v_down",
    "psi_north", "psi_east", "psi_down",
    "accelerometer_x", "accelerometer_y", "accelerometer_z",
    "gyroscope_x", "gyroscope_y", "gyroscope_z",
)  # fmt: skip
"""Error states of the filter: position (m), velocity (m/s) and attitude (rad) in the navigation
frame, biases in body axes (m/s², rad/s)."""
FILTER_STATES = len(FILTER_NAMES)

BATCH_NAMES = ("north", "east", "v_north", "v_east", "psi_north", "psi_east", "psi_down")
"""Error states of a batch: m, m/s, rad."""
BATCH_STATES = len(BATCH_NAMES)
BATCH = np.array([FILTER_NAMES.index(name) for name in BATCH_NAMES])
"""Their indices among the filter's."""
HORIZONTAL_STATES = 4
"""The first of them: position and velocity."""
HEADING = BATCH_NAMES.index("psi_down")
"""Its index among them."""


class Estimate(NamedTuple):
    """What one navigator takes as its position, velocity and attitude; or R of them, with an axis
    of runs before each."""

    position: Array
    """(3,) latitude rad, longitude rad, height m."""
    velocity: Array
    """(3,) m/s, north, east, down."""
    attitude: Array
    """(4,) quaternion body to NED."""


def batch_difference(after: Estimate, before: Estimate) -> Array:
    """Return (7,) the difference of two estimates, after minus before, in the states of a
    batch."""
    position, origin = after.position, before.position
    shift = horizontal_difference(position[0], position[1], origin[0], origin[1])
    w, x, y, z = before.attitude
    turn = to_rotation_vector(*multiply(*after.attitude, w, -x, -y, -z))
    return np.array([*shift, *(after.velocity - before.velocity)[:2], *turn])


def batch_covariance(position: float, velocity: float, tilt: float, heading: float) -> Array:
    """Return (7, 7), the covariance of independent errors, equal to north and east, by their
    1-sigma: m, m/s, rad."""
    return np.diag(np.repeat(np.square([position, velocity, tilt, heading]), [2, 2, 2, 1]))


def level(covariance: Array) -> Array:
    """Return (7, 7) that of position and velocity (4, 4) of a navigator that knows its attitude:
    to 1e-12 rad, from which nothing follows."""
    whole = np.diag(np.full(BATCH_STATES, 1e-24))
    whole[:HORIZONTAL_STATES, :HORIZONTAL_STATES] = covariance
    return whole
