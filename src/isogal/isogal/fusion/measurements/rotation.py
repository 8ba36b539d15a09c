"""Zero rotation: a vehicle that stands still on the ground turns with the Earth alone, so that its
gyroscopes read their own errors (Groves 2013, section 15.3.3):

    z = rate,    h = C' w_ie + b,    v ~ N(0, sigma² I)

with the turn of the Earth w_ie (NED), the attitude C (body to NED) and all biases b, those that
change within a run included. What the gyroscopes' scale factors make of the Earth's turn is below
the noise of any that needs it."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements.model import Innovation, Rows, update_linear
from isogal.fusion.measurements.rest import felt_at_rest
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.rotations import cross_matrix, matrix


@dataclass(frozen=True, slots=True, eq=False)
class ZeroRotation:
    """What the gyroscopes of a vehicle read that does not turn."""

    rate: Array
    """(3,) rad/s, body axes, mean over an interval."""
    sigma: float
    """1-sigma of its white noise, rad/s."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        to_body = matrix(state.attitude).T
        _, earth = felt_at_rest(state.position, model)
        H = np.zeros((3, model.states))
        # the attitude's error turns the nominal on the left: C' w changes by C' [w x] psi
        H[:, 6:9], H[:, 12:15] = to_body @ cross_matrix(earth), np.eye(3)
        expected = to_body @ earth + state.gyroscope_bias
        for j, one in enumerate(model.auxiliary):
            if one.enters == "gyroscope":
                H[one.axis, FILTER_STATES + j] = 1.0
                expected[one.axis] += state.auxiliary[j]
        R = self.sigma**2 * np.eye(3)
        return update_linear(state, model, Rows(np.array(self.rate), expected, H, R))
