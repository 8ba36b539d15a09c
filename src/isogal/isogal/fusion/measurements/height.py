"""A height sensor, and its errors as states of the filter (docs/mathematics.md, section 3.11):

    z = h (1 + s) + b + w + v

with the height h (m), a scale factor s, a constant offset b, what the weather adds, w, and white
noise v.

Readings that come with the inertial data (`InertialNavigator.imu`) are used by the compiled filter
in the same way."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements.model import Innovation, LinearMeasurement, Rows
from isogal.fusion.measurements.trust import update_insistent
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.scenario import Height

UNKNOWN_HEIGHT = 1000.0
"""m, 1-sigma of the height at the start where a sensor measures it: the first reading tells it."""


def height_error_states(height: Height) -> tuple[AuxiliaryState, ...]:
    """Return the sensor's constant offset, its scale factor error and what the weather adds; none
    where the scenario gives the height."""
    if not height.measured:
        return ()
    weather, time = height.weather_sigma, height.weather_time
    return (
        AuxiliaryState(f"{height.prefix}_bias", "none", 0, height.bias),
        AuxiliaryState(f"{height.prefix}_scale", "none", 0, height.scale),
        AuxiliaryState(f"{height.prefix}_weather", "none", 0, weather, time=time),
    )


def by_auxiliary(model: FilterModel, height: ArrayLike, prefix: str = "height") -> Array:
    """Return (..., M) by how much a reading at heights (...), m, changes with each auxiliary
    state."""
    constant, share = model.height_contents(prefix)
    return np.asarray(constant + share * np.asarray(height)[..., None])


@dataclass(frozen=True, slots=True)
class HeightReading(LinearMeasurement):
    """A reading of the height."""

    height: float
    """m."""
    variance: float
    """m², of its white noise."""
    prefix: str = "height"
    """Of the names of its states."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        return update_insistent(state, model, self.rows(state, model), self.prefix)

    def rows(self, state: FilterState, model: FilterModel) -> Rows:
        """Return it linearised at a state."""
        up = float(state.position[2])
        contents = by_auxiliary(model, up, self.prefix)
        H = np.zeros((1, model.states))
        H[0, 2], H[0, FILTER_STATES:] = -1.0, contents
        expected = np.array([up + contents @ state.auxiliary])
        return Rows(np.array([self.height]), expected, H, np.array([[self.variance]]))
