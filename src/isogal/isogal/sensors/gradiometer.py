"""The gradiometer: components of the gravity gradient tensor at the vehicle, several numbers at
each scan (docs/mathematics.md, section 2.7).

It measures the gradient of gravity in axes north, east, down, at the vehicle's height. The
reduction takes off the normal gradient at the navigator's own latitude and height, which leaves
the gradient of the disturbing potential, as in the maps. The normal gradient changes by 0.003 E
per kilometre of latitude and 0.001 E per metre of height, so the effect of the navigator's error
on the reduction is neglected.

The platform is to be level and to point north (how well: `gradiometer_errors`), and the instrument
to correct for the platform's own rotation (Jekeli 1988, The gravity gradiometer survey system, EOS
69)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.gravity import normal_gradient
from isogal.scenario import TENSOR_COMPONENTS
from isogal.sensors.gradiometer_errors import places_in_tensor
from isogal.sensors.reduction import Reduction, State


class GradientReduction(Reduction):
    """From the measured gravity gradient (..., C), 1/s², to that of the disturbing potential.

    Parameters
    ----------
    components : sequence of str
        C of `scenario.TENSOR_COMPONENTS`.
    """

    def __init__(self, components: Sequence[str] = TENSOR_COMPONENTS) -> None:
        self._rows, self._columns = places_in_tensor(components)

    def _normal(self, at: State) -> Array:
        return normal_gradient(at.latitude, at.height)[..., self._rows, self._columns]

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the measured gradient where that of the disturbing potential is given."""
        return np.asarray(value) + self._normal(at)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the measured gradient less the normal one."""
        return np.asarray(raw) - self._normal(at)
