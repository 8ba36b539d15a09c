"""What every instrument of a mapped field provides, so that engine, nodes and batches need not
know which one it is (docs/mathematics.md, section 2.5)."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array


class State(NamedTuple):
    """Position and velocity of a sensor, true or as the navigator estimates them. Numbers or
    arrays that broadcast."""

    latitude: ArrayLike
    """rad."""
    longitude: ArrayLike
    """rad."""
    height: ArrayLike
    """m above the map's surface."""
    v_north: ArrayLike
    """m/s."""
    v_east: ArrayLike
    attitude: Array | None = None
    """(..., 3, 3) body to north, east, down, for instruments that look aside; None = not known."""
    turn: Array | None = None
    """(..., 3) angular rate, body axes, rad/s, for instruments away from the inertial sensors;
    None = taken as zero."""


class Reduction(Protocol):
    """From a sensor's raw readings to values of the map, and back. What has a body here is so of
    an instrument whose class extends this one and says nothing else."""

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return what a perfect sensor measures where the field has a value; raises InputError
        where a sensor cannot be."""
        ...

    def report(self, raw: ArrayLike) -> Array:
        """Return what a sensor reports when it measures `raw`: rounded as its message rounds, NaN
        beyond its range."""
        return np.asarray(raw, dtype=float)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the map's value from a reading and the navigator's own estimate."""
        ...

    def jacobian(self, at: State) -> Array:
        """Return d(reduced)/d(navigator's error) (..., 4) for errors (north m, east m, v_north
        m/s, v_east m/s) at the scan; zeros where the reduction does not depend on them."""
        return np.zeros((*np.shape(at.latitude), 4))

    def height_slope(self, at: State) -> Array:
        """Return d(reduced)/d(navigator's height error), per m."""
        return np.zeros(np.shape(at.latitude))

    def dated(self, time: float) -> "Reduction":
        """Return the reduction of readings at a time, s, where the field changes with the date."""
        return self


class AsRead(Reduction):
    """Of readings that are values of the map already: nothing of the navigator is in them."""

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the map's value."""
        return np.array(value, dtype=float)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the reading."""
        return np.array(raw, dtype=float)


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
