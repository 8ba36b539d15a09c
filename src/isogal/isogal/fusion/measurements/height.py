"""A height sensor, and its errors as states of the filter (docs/mathematics.md, section 3.11):

    z = h (1 + s) + b + w + v

with the height h (m), a scale factor s, a constant offset b, what the weather adds, w, and white
noise v.

Readings that come with the inertial data (`InertialNavigator.imu`) are used by the compiled filter
in the same way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements.model import Innovation, Rows
from isogal.fusion.measurements.trust import update_insistent
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.scenario import Height

UNKNOWN_HEIGHT = 1000.0
"""m, 1-sigma of the height at the start where a sensor measures it: the first reading tells it."""
_BIAS, _SCALE, _WEATHER = "height_bias", "height_scale", "height_weather"


def height_error_states(height: Height) -> tuple[AuxiliaryState, ...]:
    """Return the sensor's constant offset, its scale factor error and what the weather adds, those
    that are not zero; none where the scenario gives the height."""
    if not height.measured:
        return ()
    every = (
        AuxiliaryState(_BIAS, "none", 0, height.bias),
        AuxiliaryState(_SCALE, "none", 0, height.scale),
        AuxiliaryState(_WEATHER, "none", 0, height.weather_sigma, time=height.weather_time),
    )
    return tuple(state for state in every if state.sigma > 0.0)


def height_contents(auxiliary: Sequence[AuxiliaryState]) -> tuple[tuple[float, float], ...]:
    """Return what a reading contains of each auxiliary state (`FilterModel.height_contents`)."""
    factor = {_BIAS: (1.0, 0.0), _WEATHER: (1.0, 0.0), _SCALE: (0.0, 1.0)}
    return tuple(factor.get(one.name, (0.0, 0.0)) for one in auxiliary)


def by_auxiliary(model: FilterModel, height: ArrayLike) -> Array:
    """Return (..., M) by how much a reading at heights (...), m, changes with each auxiliary
    state."""
    constant, share = model.height_errors.T
    return np.asarray(constant + share * np.asarray(height)[..., None])


@dataclass(frozen=True, slots=True)
class HeightReading:
    """A reading of the height."""

    height: float
    """m."""
    variance: float
    """m², of its white noise."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        up = float(state.position[2])
        contents = by_auxiliary(model, up)
        H = np.zeros((1, model.states))
        H[0, 2], H[0, FILTER_STATES:] = -1.0, contents
        expected = np.array([up + contents @ state.auxiliary])
        rows = Rows(np.array([self.height]), expected, H, np.array([[self.variance]]))
        return update_insistent(state, model, rows, "height")
