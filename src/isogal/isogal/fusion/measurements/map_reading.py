"""A reading of a map as a measurement by itself, linear about a place that is known beforehand
(docs/mathematics.md, section 3.18):

    reduced(x0) - m = (g - J) (x - x0) + u + b + white noise

with the reading reduced at a reference x0, the Jacobian J of the reduction, the map as m + g (x -
x0), the map's error u and slow errors b of the instrument. m and g are the map's statistical
regression over what is known of the place (García-Fernández, Svensson & Särkkä 2017); what they
leave of the map is white noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import displaced, horizontal_difference
from isogal.fusion.measurements.model import Innovation, Rows, update_linear
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.maps.tiled_map import ScalarMap

_OFFSETS = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)]) * np.sqrt(3.0)
_WEIGHTS = np.prod(np.where(_OFFSETS == 0.0, 2.0 / 3.0, 1.0 / 6.0), axis=1)
"""Gauss-Hermite rule of three points an axis."""


class LinearMap(NamedTuple):
    """A map about K places."""

    value: Array
    """(K,) m; NaN = the map has nothing there."""
    slope: Array
    """(K, 2) g, per m to north and east."""
    left: Array
    """(K,) variance of what these leave."""


def linear_map(
    field_map: ScalarMap, latitude: Array, longitude: Array, covariance: Array
) -> LinearMap:
    """Return the regression of a map over places (K,), rad, of a covariance (K, 2, 2), m²."""
    root = np.linalg.cholesky(covariance)
    shift = np.einsum("kij,qj->kqi", root, _OFFSETS)
    values = field_map.value(*displaced(latitude[:, None], longitude[:, None], shift))
    mean = values @ _WEIGHTS
    across = np.einsum("q,kq,qi->ki", _WEIGHTS, values, _OFFSETS)  # in units of the root
    slope = np.linalg.solve(root.swapaxes(1, 2), across[..., None])[..., 0]
    spread = (values - mean[:, None]) ** 2 @ _WEIGHTS
    left = np.maximum(spread - (across**2).sum(axis=1), 0.0)
    return LinearMap(mean, slope, left)


@dataclass(frozen=True, slots=True, eq=False)
class MapReading:
    """A reading about a reference."""

    reference: Array
    """(5,) latitude, longitude rad, height m, velocity north and east m/s."""
    residual: float
    """Reduced there, less the map's value."""
    slope: Array
    """(2,) of the map, per m."""
    jacobian: Array
    """(4,) of the reduction by errors of north, east (m), v_north, v_east (m/s)."""
    by_height: float
    """Of the reduction by an error of the height, per m."""
    variance: float
    contents: Sequence[str]
    """Names of the auxiliary states that are in it."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        latitude, longitude, height, v_north, v_east = self.reference
        apart = horizontal_difference(state.position[0], state.position[1], latitude, longitude)
        by_place = self.slope - self.jacobian[:2]
        expected = float(by_place @ np.asarray(apart))
        expected -= float(self.jacobian[2:] @ (state.velocity[:2] - [v_north, v_east]))
        expected -= self.by_height * float(state.position[2] - height)
        H = np.zeros((1, model.states))
        H[0, :2], H[0, 3:5] = by_place, -self.jacobian[2:]
        H[0, 2] = self.by_height
        first = model.states - len(state.auxiliary)
        for at in (model.places[name] for name in self.contents):
            H[0, at] = 1.0
            expected += float(state.auxiliary[at - first])
        rows = Rows(
            np.array([self.residual]), np.array([expected]), H, np.array([[self.variance]])
        )
        return update_linear(state, model, rows)
