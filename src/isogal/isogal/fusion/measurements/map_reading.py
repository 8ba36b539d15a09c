"""A reading of a map as a measurement by itself, linear about a place that is known beforehand
(docs/mathematics.md, section 3.18):

    reduced(x0) - m = (g - J) (x - x0) + u + b + white noise

with the reading reduced at a reference x0, the Jacobian J of the reduction, the map as m + g (x -
x0), the map's error u and slow errors b of the instrument. m and g are the map's statistical
regression over what is known of the place (García-Fernández, Svensson & Särkkä 2017); what they
leave of the map is white noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import displaced, horizontal_difference
from isogal.fusion.measurements.model import LinearMeasurement, Rows
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.maps.tiled_map import ScalarMap

_OFFSETS = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)]) * np.sqrt(3.0)
_WEIGHTS = np.prod(np.where(_OFFSETS == 0.0, 2.0 / 3.0, 1.0 / 6.0), axis=1)
"""Gauss-Hermite rule of three points an axis."""


def linear_map(
    field_map: ScalarMap, latitude: Array, longitude: Array, covariance: Array
) -> tuple[Array, Array, Array]:
    """Return the regression of a map over places (K,), rad, of a covariance (K, 2, 2), m²: its
    value m (K,), NaN where the map has nothing, its slope g (K, 2), per m to north and east, and
    the variance (K,) of what these leave."""
    root = np.linalg.cholesky(covariance)
    shift = np.einsum("kij,qj->kqi", root, _OFFSETS)
    values = field_map.value(*displaced(latitude[:, None], longitude[:, None], shift))
    mean = values @ _WEIGHTS
    across = np.einsum("q,kq,qi->ki", _WEIGHTS, values, _OFFSETS)  # in units of the root
    slope = np.linalg.solve(root.swapaxes(1, 2), across[..., None])[..., 0]
    spread = (values - mean[:, None]) ** 2 @ _WEIGHTS
    return mean, slope, np.maximum(spread - (across**2).sum(axis=1), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class MapReading(LinearMeasurement):
    """A reading about a reference."""

    reference: Array
    """(5,) latitude, longitude rad, height m, velocity north and east m/s."""
    residual: float
    """Reduced there, less the map's value."""
    by_error: Array
    """(5,) what it changes by with errors of north, east, down (m), v_north, v_east (m/s)."""
    variance: float
    contents: Sequence[str]
    """Names of the auxiliary states that are in it."""

    def rows(self, state: FilterState, model: FilterModel) -> Rows:
        """Return it linearised at a state."""
        latitude, longitude, height, *velocity = self.reference
        apart = horizontal_difference(state.position[0], state.position[1], latitude, longitude)
        error = [*apart, height - state.position[2], *(state.velocity[:2] - velocity)]
        H, expected = np.zeros((1, model.states)), self.by_error @ np.array([error]).T
        H[0, :5] = self.by_error
        for at in (model.places[name] for name in self.contents):
            H[0, at] = 1.0
            expected += state.auxiliary[at - FILTER_STATES]
        return Rows(np.array([self.residual]), expected, H, np.array([[self.variance]]))
