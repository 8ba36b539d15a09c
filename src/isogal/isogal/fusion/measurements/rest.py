"""What the inertial sensors of a vehicle at rest read: gravity and the Earth's rotation
(docs/mathematics.md, section 3.20):

    z = (C' (-g) + b_a, C' w_ie + b_g) + noise

with gravity g and the Earth's rate w_ie (NED), the attitude C (body to NED) and the sensors'
errors, which are their biases and auxiliary states. It levels and finds north. Its gyroscopes'
rows alone are the measurement of zero rotation (Groves 2013, section 15.3.3). The samples that it
is made of must not also have carried the state to its time: their noise would count twice."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.earth.gravity import normal_gravity_at
from isogal.fusion.measurements.model import LinearMeasurement, Rows
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.gravity import horizontal_gravity
from isogal.inertial.rotations import cross_matrix, matrix


def sensed_at_rest(position: Array, model: FilterModel) -> tuple[Array, Array]:
    """Return the specific force (m/s²) and the angular rate (rad/s), NED, of a vehicle at rest at
    a position (3,)."""
    latitude, _, height = position.tolist()
    s, c = math.sin(latitude), math.cos(latitude)
    north, east = horizontal_gravity(model.gravity.compensation, position)
    force = -np.array([north, east, normal_gravity_at(s, height)])
    return force, EARTH_RATE * np.array([c, 0.0, -s])


@dataclass(frozen=True, slots=True, eq=False)
class AtRest(LinearMeasurement):
    """Means of the inertial data of a vehicle at rest, or of its gyroscopes' alone."""

    force: Array
    """(3,) specific force, body, m/s²; NaN = not used."""
    rate: Array
    """(3,) angular rate, body, rad/s."""
    seconds: float
    """Over which they are means."""
    rate_sigma: float | None = None
    """1-sigma of the noise of such a mean of a gyroscope, rad/s; None = its white noise's."""

    def rows(self, state: FilterState, model: FilterModel) -> Rows:
        """Return it linearised at a state."""
        force, rate = sensed_at_rest(state.position, model)
        to_body = matrix(state.attitude).T
        H = np.zeros((6, model.states))
        H[:3, 6:9] = to_body @ cross_matrix(force)
        H[3:, 6:9] = to_body @ cross_matrix(rate)
        H[:, 9:15] = np.eye(6)
        for j, one in enumerate(model.auxiliary):
            row, share = one.input
            if row >= 3:
                H[row - 3, FILTER_STATES + j] = (1.0, *self.force, *self.rate)[share]
            elif row >= 0:
                H[:3, FILTER_STATES + j] = -to_body[:, row]
        expected = np.concatenate([to_body @ force, to_body @ rate])
        expected += H[:, 9:] @ np.concatenate(state.nominal[3:])
        variance = np.square(model.noise) / self.seconds
        if self.rate_sigma is not None:
            variance[3:] = self.rate_sigma**2
        read = np.concatenate([self.force, self.rate])
        used = np.flatnonzero(np.isfinite(read))
        return Rows(read[used], expected[used], H[used], np.diag(variance[used]))
