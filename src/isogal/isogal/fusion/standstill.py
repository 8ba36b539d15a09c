"""Whether a vehicle that was at rest at the start still is.

Inertial sensors cannot tell a vehicle at rest from one that goes straight ahead at a constant
speed. That it is at rest at first is for others to say: a velocity aid, or whoever starts a
navigator without one (`isogal.fusion.alignment`). That it no longer is shows in the first samples
that differ from those of the rest."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements import VelocityReading
from isogal.fusion.model import FilterModel
from isogal.scenario import Velocity

BEYOND = 6.0
"""Sigmas of the sensors' white noise by which a sample of a vehicle at rest may differ from the
mean of those before."""
LEAST = np.array([0.02, 1e-3])
"""m/s², rad/s: less is no motion but an engine, a door or the wind. A smaller acceleration shows
in the velocity, which then is not zero."""
CONFIRMED = 3.0
"""s without motion after which a vehicle was at rest: of what begins slowly the first second is
not yet seen."""
REST_SIGMA = 1e-3
"""m/s, 1-sigma of the velocity of a vehicle at rest: it trembles."""
_RESTS = Velocity(standstill_speed=BEYOND, standstill_sigma=REST_SIGMA)


def zero_velocity() -> VelocityReading:
    """Return the measurement of a vehicle at rest."""
    return VelocityReading(np.zeros(3), np.eye(3), _RESTS)


class Standstill:
    """Compares samples with the mean of those since the vehicle has been at rest.

    Parameters
    ----------
    model : FilterModel
        Its white noise is that of the sensors.
    """

    def __init__(self, model: FilterModel) -> None:
        # the vertical accelerometer's noise stands for unknown gravity, too
        noise = np.array(model.noise)[[0, 1, 1, 3, 4, 5]]
        sizes = np.linalg.norm(noise.reshape(2, 3), axis=1) / math.sqrt(model.dt)
        self._limits = np.maximum(BEYOND * sizes, LEAST)
        self.forget()

    def forget(self) -> None:
        """Begin anew: the next sample is the first at rest."""
        self._sum, self._seconds = np.zeros(6), 0.0

    @property
    def seconds(self) -> float:
        """How long the vehicle has been at rest, s."""
        return self._seconds

    @property
    def means(self) -> tuple[Array, Array]:
        """(3,) and (3,): specific force and angular rate over that time, body axes."""
        mean = self._sum / max(self._seconds, 1e-9)
        return mean[:3], mean[3:]

    def take(self, force: Array, rate: Array, dt: float) -> bool:
        """Take a sample of an interval (s), and return whether the vehicle is at rest; where it is
        not, all before is forgotten."""
        if self._seconds > 0.0:
            mean = self.means
            away = [np.linalg.norm(force - mean[0]), np.linalg.norm(rate - mean[1])]
            if (np.array(away) > self._limits).any():
                self.forget()
                return False
        self._sum += np.concatenate([force, rate]) * dt
        self._seconds += dt
        return True
