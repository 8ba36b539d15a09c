"""Mean and covariance of the filter."""

import math
from dataclasses import dataclass, field, fields
from operator import attrgetter

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.fusion.clone import NO_CLONE, Clone
from isogal.fusion.model import FilterModel
from isogal.fusion.nominal import Nominal
from isogal.inertial.error_state import BATCH, Estimate
from isogal.inertial.rotations import rotate

_BATCH = np.ix_(BATCH, BATCH)


@dataclass(slots=True, eq=False)
class FilterState:
    """Mean and covariance of one navigator; updates change the arrays in place."""

    position: Array
    """(3,) latitude rad, longitude rad, height m."""
    velocity: Array
    """(3,) m/s NED."""
    attitude: Array
    """(4,) quaternion body to NED."""
    accelerometer_bias: Array
    """(3,) m/s², body."""
    gyroscope_bias: Array
    """(3,) rad/s, body."""
    auxiliary: Array
    """(M,) of the auxiliary states (`FilterModel.auxiliary`)."""
    covariance: Array
    """(15 + M, 15 + M) of the filter's error state (`isogal.inertial.error_state`), then of the
    auxiliary states."""
    residual_gravity: Array
    """(2,) 1-sigma (m/s²) and correlation length (m) of the horizontal gravity that no
    compensation takes off, since the map's error has been learnt; 0 = as the model has it."""
    clone: Clone = NO_CLONE
    """Errors of an earlier time that are kept along."""
    contradicted: dict[str, int] = field(default_factory=dict)
    """How many readings of an aid, by its name, have to agree before it is used again: fixes, or
    other sensors, have contradicted a navigator that used it."""
    insisting: dict[str, int] = field(default_factory=dict)
    """How many readings of an aid, by its name, were beyond the gate, one after the other."""

    def __post_init__(self) -> None:
        """Raise ValueError where the clone is of another number of states: compiled loops would
        write beyond its end."""
        rows, states = self.clone.cross.shape
        if rows and states != len(self.covariance):
            raise ValueError(f"a clone is of {states} states, not of {len(self.covariance)}")

    @classmethod
    def start(cls, estimate: Estimate, model: FilterModel) -> "FilterState":
        """Return the state at the start: biases and auxiliary states zero, covariance diagonal."""
        auxiliary = [state.sigma for state in model.auxiliary]
        return cls(
            np.array(estimate.position, dtype=float),
            np.array(estimate.velocity, dtype=float),
            np.array(estimate.attitude, dtype=float),
            np.zeros(3),
            np.zeros(3),
            np.zeros(len(auxiliary)),
            np.diag(np.square([*model.initial_sigma, *auxiliary])),
            np.zeros(2),
        )

    def copy(self) -> "FilterState":
        """Return a state that shares nothing with this one."""
        return FilterState(*[part.copy() for part in _parts(self)])

    def arrays(self) -> tuple[Array, ...]:
        """Return all arrays, those of the mean first."""
        return (*self.nominal, self.covariance, self.residual_gravity)

    @property
    def batch_prior(self) -> Array:
        """(7, 7) covariance of (north m, east m, v_north, v_east m/s, attitude rad): what a batch
        takes as prior."""
        return self.covariance[_BATCH]

    @property
    def nominal(self) -> Nominal:
        """The mean as the kernels take it; shares the arrays."""
        return Nominal(
            self.position,
            self.velocity,
            self.attitude,
            self.accelerometer_bias,
            self.gyroscope_bias,
            self.auxiliary,
        )

    @property
    def estimate(self) -> Estimate:
        """Position, velocity and attitude; they share the arrays."""
        return Estimate(self.position, self.velocity, self.attitude)

    def turn_rate(self, angular_rate: Array) -> Array:
        """Return the angular rate (3,) relative to the Earth, body axes, rad/s: that of the
        gyroscopes (3,) without their biases and the Earth's rotation."""
        latitude = float(self.position[0])
        north, down = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
        w, x, y, z = self.attitude.tolist()
        of_earth = np.array(rotate(w, -x, -y, -z, north, 0.0, down))
        return angular_rate - self.gyroscope_bias - of_earth


_parts = attrgetter(*(one.name for one in fields(FilterState)))
