"""Components of the gravity gradient tensor as messages.

No standard message holds a tensor. A PointCloud2 has a stamp and describes its own content: a
reading is one point with a field for each component (T_nn, T_ne, T_nd, T_ee, T_ed, T_dd; 1/s²) and
the field `covariance` of C x C numbers, row by row in the order of those fields. Numbers are found
by name, so that components may be left out and none is put where another quantity is meant."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.maps.quantities import QUANTITIES
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.adapter import Framed, Place
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_frame
from isogal_ros.messages.point import fill_point, numbers, read_point

GRADIOMETER = "gradiometer_link"
"""Frame of a level platform that points north: x north, y east, z down, as the components are
named."""
PREFIX, COVARIANCE = "T_", "covariance"
_LARGEST = 2.0 * QUANTITIES["gradient"].highest
"""1/s²: the normal gradient's 3.1e-6 and what the Earth's crust adds."""


def gradient(scenario: Scenario) -> "GradiometerAdapter":
    """Return the adapter of the field gradient."""
    return GradiometerAdapter(scenario.gradiometer.components)


class GradiometerAdapter(Framed):
    """Gradient of gravity and of the disturbing potential, some components of each.

    Parameters
    ----------
    components : sequence of str
        Of `scenario.TENSOR_COMPONENTS`; readings are in their order, whatever the order in a
        message.
    """

    raw, reduced = topics.FULL_GRADIENT, topics.GRADIENT
    frames = GRADIOMETER, GRADIOMETER

    def __init__(self, components: Sequence[str]) -> None:
        self._names = [PREFIX + name for name in components]

    def new_raw(self) -> Any:
        """Return a message of one point, without readings."""
        message = super().new_raw()
        count = len(self._names)
        self.fill_raw(message, 0, np.full(count, np.nan), np.zeros((count, count)))
        return message

    def fill_raw(self, message: Any, ns: int, value: Array, variance: Array) -> None:
        """Write a gradient felt (C,), 1/s², and its covariance (C, C)."""
        components = np.broadcast_to(value, len(self._names))
        content = dict(zip(self._names, components, strict=True))
        fill_point(message, ns, {**content, COVARIANCE: variance})

    def fill_reduced(
        self, message: Any, ns: int, value: Array, variance: Array, place: Place
    ) -> None:
        """Write a gradient of the disturbing potential (C,), 1/s², and its covariance (C, C)."""
        self.fill_raw(message, ns, value, variance)

    def read_raw(self, message: Any) -> tuple[Array, Array | None]:
        """Return the gradient felt (C,), NaN = no reading of that component, and its covariance;
        None = unknown (zero)."""
        value, covariance = self.read_reduced(message)
        return value, covariance if covariance.any() else None

    def read_reduced(self, message: Any) -> tuple[Array, Array]:
        """Return the gradient (C,), NaN = no reading of that component, and its covariance."""
        require_frame(message, GRADIOMETER)
        content = read_point(message, lambda name: name.startswith(PREFIX) or name == COVARIANCE)
        value = np.concatenate([numbers(content, name, 1) for name in self._names])
        # the covariance has a row for each component in the message, in its order
        order = [name for name in content if name != COVARIANCE]
        rows = [order.index(name) for name in self._names]
        whole = numbers(content, COVARIANCE, len(order) ** 2).reshape(len(order), len(order))
        covariance = whole[np.ix_(rows, rows)]
        if np.isinf(value).any() or np.nanmax(np.abs(value), initial=0.0) > _LARGEST:
            raise BadMessageError(
                f"a component above {_LARGEST:g} 1/s² is not the Earth's; the unit is 1/s²"
            )
        require_covariance(covariance)
        return value, covariance
