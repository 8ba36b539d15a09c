"""Auxiliary states of a height sensor's errors, and what its readings say
(docs/mathematics.md, section 3.11)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.scenario import Height

UNKNOWN_HEIGHT = 1000.0
"""m, 1-sigma of the height at the start where a sensor measures it: the first reading tells it."""
_BIAS, _SCALE, _WEATHER = "height_bias", "height_scale", "height_weather"


class HeightReading(NamedTuple):
    """What a reading of the height contains beside the height, as the kernels take it: offset[j]
    + share[j] * height per unit of auxiliary state j."""

    offset: Array
    """(M,)."""
    share: Array
    """(M,) 1/m."""


def states(height: Height) -> tuple[AuxiliaryState, ...]:
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


def reading_of(auxiliary: Sequence[AuxiliaryState]) -> HeightReading:
    """Return what a reading of the height contains of some auxiliary states."""
    names = [state.name for state in auxiliary]
    return HeightReading(
        np.array([float(name in (_BIAS, _WEATHER)) for name in names], dtype=float),
        np.array([float(name == _SCALE) for name in names], dtype=float),
    )
