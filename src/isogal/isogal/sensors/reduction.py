"""What a sensor of a scalar field has to say about itself, so that engine, nodes and batches can
use any of them alike."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array


class State(NamedTuple):
    """Where a sensor was, or where the navigator takes it to have been. Numbers or arrays that
    broadcast."""

    latitude: ArrayLike
    """rad."""
    longitude: ArrayLike
    """rad."""
    height: ArrayLike
    """m above the map's surface."""
    v_north: ArrayLike
    """m/s."""
    v_east: ArrayLike


class Reduction(Protocol):
    """From what a sensor feels to values of the map, and back."""

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return what a perfect sensor feels where the field has a value; raises InputError where
        no such sensor can be."""
        ...

    def report(self, raw: ArrayLike) -> Array:
        """Return what a sensor says that feels `raw`: rounded as its message rounds, NaN beyond
        its range."""
        ...

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the map's value from a reading and the navigator's own estimate."""
        ...

    def jacobian(self, at: State) -> Array:
        """Return d(reduced)/d(navigator's error) (..., 4) for errors (north m, east m, v_north
        m/s, v_east m/s) at the scan."""
        ...

    def height_slope(self, at: State) -> Array:
        """Return d(reduced)/d(navigator's height error), per m."""
        ...


def reduction_variance(
    reduction: Reduction, at: State, covariance: Array, height_variance: ArrayLike
) -> Array:
    """Return the variance that the navigator's uncertainty puts into a reduced reading, unit of
    the map squared.

    Parameters
    ----------
    at : State
        The navigator's estimate.
    covariance : (..., 4, 4) array
        Of (north, east, v_north, v_east) errors; height_variance (...) m².
    """
    jacobian = reduction.jacobian(at)
    by_height = reduction.height_slope(at) ** 2 * np.asarray(height_variance)
    return np.einsum("...i,...ij,...j->...", jacobian, covariance, jacobian) + by_height
