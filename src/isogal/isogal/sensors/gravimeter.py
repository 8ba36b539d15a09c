"""The gravimeter: what it measures on a moving vehicle, and the reductions, which use the
navigator's own estimate (docs/mathematics.md, sections 2.4 to 2.6).

It measures gravity at the vehicle, less the Eötvös acceleration, plus noise. Reduced gravity
refers to the map's surface: Eötvös and free-air terms are added back with estimated velocity,
latitude and height. The disturbance is reduced gravity less normal gravity at the estimated
latitude. The map's surface is at ellipsoidal height 0, and the vehicle `route.height` above it."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE, radii
from isogal.earth.gravity import (
    FREE_AIR,
    eotvos,
    eotvos_jacobian,
    normal_gravity,
    normal_gravity_gradient_north,
)
from isogal.sensors.reduction import Reduction, State

NO_ARM = (0.0, 0.0, 0.0)
"""An instrument at the inertial sensors."""


class GravityReduction(Reduction):
    """From a gravimeter's reading (m/s²) to gravity on the map's surface.

    Parameters
    ----------
    arm : (forward, right, down), optional
        Of the instrument from the inertial sensors, m.
    """

    def __init__(self, arm: tuple[float, float, float] = NO_ARM) -> None:
        self._arm = arm

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return what is measured over a point whose gravity on the map's surface is given."""
        return np.asarray(value) - self._motion(at)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return gravity on the map's surface from a reading and the navigator's state."""
        return np.asarray(raw) + self._motion(at)

    def _motion(self, at: State) -> Array:
        """Return what height and motion of the instrument take off gravity (docs/mathematics.md,
        section 2.4). With an arm it is at another height, moves at another velocity, and is
        accelerated as the vehicle turns; without an attitude the arm has no effect."""
        height, north, east = (np.asarray(x) for x in (at.height, at.v_north, at.v_east))
        down: Array = np.zeros(())
        if at.attitude is not None and self._arm != NO_ARM:
            turn = np.zeros(3) if at.turn is None else at.turn
            around = np.cross(turn, self._arm)
            whole = np.stack(np.broadcast_arrays(self._arm, around, np.cross(turn, around)), -1)
            offset, velocity, acceleration = np.moveaxis(at.attitude @ whole, -1, 0)
            height, down = height - offset[..., 2], acceleration[..., 2]
            north, east = north + velocity[..., 0], east + velocity[..., 1]
        return np.asarray(FREE_AIR * height + eotvos(at.latitude, height, north, east) + down)

    def jacobian(self, at: State) -> Array:
        """Return d(reduced)/d(navigator's error) (..., 4): with a wrong velocity or latitude a
        wrong Eötvös term is added."""
        lat = np.asarray(at.latitude, dtype=float)
        jacobian = np.zeros((*lat.shape, 4))
        jacobian[..., 2], jacobian[..., 3] = eotvos_jacobian(lat, at.v_north, at.v_east)
        jacobian[..., 0] = -2.0 * EARTH_RATE * np.sin(lat) * np.asarray(at.v_east) / radii(lat)[0]
        return jacobian

    def height_slope(self, at: State) -> Array:
        """Return the free-air gradient, s⁻²."""
        return np.full(np.shape(at.latitude), FREE_AIR)


class DisturbanceReduction(GravityReduction):
    """From a gravimeter's reading (m/s²) to the gravity disturbance: reduced gravity less normal
    gravity at the navigator's latitude."""

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return what is measured over a point of a given disturbance."""
        return super().raw(np.asarray(value) + normal_gravity(at.latitude), at)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the disturbance from a reading and the navigator's state."""
        return super().reduce(raw, at) - normal_gravity(at.latitude)

    def jacobian(self, at: State) -> Array:
        """Return that of gravity, less what a wrong latitude changes normal gravity by."""
        jacobian = super().jacobian(at)
        jacobian[..., 0] -= normal_gravity_gradient_north(np.asarray(at.latitude, dtype=float))
        return jacobian
