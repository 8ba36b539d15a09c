"""The filter's state: mean and covariance of many runs."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.fusion.model import FilterModel
from isogal.fusion.nominal import Nominal
from isogal.inertial.error_state import BATCH, Estimate
from isogal.inertial.rotations import rotate
from isogal.inertial.strapdown import NavState


@dataclass(frozen=True, slots=True, eq=False)
class FilterState:
    """Mean and covariance of R runs."""

    position: Array
    """(R, 3) latitude rad, longitude rad, height m."""
    velocity: Array
    """(R, 3) m/s NED."""
    attitude: Array
    """(R, 4) quaternion body to NED."""
    accelerometer_bias: Array
    """(R, 3) m/s², body."""
    gyroscope_bias: Array
    """(R, 3) rad/s, body."""
    auxiliary: Array
    """(R, M) of the auxiliary states (`FilterModel.auxiliary`)."""
    covariance: Array
    """(R, 15 + M, 15 + M) of the filter's error state (`isogal.inertial.error_state`), then of the
    auxiliary states."""
    contradicted: Array
    """(R,) 1 = fixes have contradicted the navigator, whose velocity aid is no longer used; 0 =
    they have not."""
    residual_gravity: Array
    """(R, 2) 1-sigma (m/s²) and correlation length (m) of the horizontal gravity that no
    compensation takes off, since the map's error has been learnt; 0 = as the model has it."""

    def __len__(self) -> int:
        return self.position.shape[0]

    @classmethod
    def start(cls, nav: NavState, model: FilterModel) -> "FilterState":
        """Return the state at the start: biases and auxiliary states zero, covariance diagonal."""
        runs, auxiliary = len(nav), [state.sigma for state in model.auxiliary]
        sigma = np.array([*model.initial_sigma, *auxiliary])
        covariance = np.tile(np.diag(sigma**2), (runs, 1, 1))
        return cls(
            nav.position.copy(),
            nav.velocity.copy(),
            nav.attitude.copy(),
            np.zeros((runs, 3)),
            np.zeros((runs, 3)),
            np.zeros((runs, len(auxiliary))),
            covariance,
            np.zeros(runs),
            np.zeros((runs, 2)),
        )

    def copy(self) -> "FilterState":
        """Return a state that shares nothing with this one."""
        return replace(self, **{name: getattr(self, name).copy() for name in self.__slots__})

    @property
    def batch_prior(self) -> Array:
        """(R, 7, 7) covariance of (north m, east m, v_north, v_east m/s, attitude rad): what a
        batch takes as prior."""
        return self.covariance[:, BATCH[:, None], BATCH]

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

    def arrays(self) -> tuple[Array, ...]:
        """Return all arrays, those of the mean first."""
        return (*self.nominal, self.covariance, self.contradicted, self.residual_gravity)

    def nominal_of(self, run: int) -> Nominal:
        """Return the mean of one run; it shares the arrays."""
        return Nominal(*(array[run] for array in self.nominal))

    def turn_rate_of(self, run: int, angular_rate: Array) -> Array:
        """Return the angular rate (3,) of one run relative to the Earth, body axes, rad/s: that of
        the gyroscopes (3,) without their biases and the Earth's rotation."""
        latitude = self.position[run, 0]
        north, down = EARTH_RATE * math.cos(latitude), -EARTH_RATE * math.sin(latitude)
        w, x, y, z = self.attitude[run]
        of_earth = np.array(rotate(w, -x, -y, -z, north, 0.0, down))
        return angular_rate - self.gyroscope_bias[run] - of_earth

    def estimate_of(self, run: int) -> Estimate:
        """Return position, velocity and attitude of one run; they share the arrays."""
        return Estimate(self.position[run], self.velocity[run], self.attitude[run])
