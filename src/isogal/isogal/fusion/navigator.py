"""The navigator: the unscented filter of many runs at once."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from isogal.arrays import Array
from isogal.fusion import ukf
from isogal.fusion.nominal import Nominal, move
from isogal.fusion.sigma_points import merwe_weights
from isogal.inertial.error_state import BATCH, Estimate
from isogal.inertial.strapdown import NavState
from isogal.scenario import Scenario
from isogal.sensors.imu import GRADES

# Floors of the initial 1-sigma, so that a scenario with a perfect start still has a positive
# definite covariance.
_POSITION_FLOOR, _VELOCITY_FLOOR, _ATTITUDE_FLOOR = 1e-3, 1e-6, 1e-9

UNKNOWN_GRAVITY = 1.6e-2
"""Vertical white noise density (m/s²/sqrt(Hz)) that stands for the gravity disturbance, which the
strapdown does not know: 36 mGal RMS over a correlation time of 1000 s, sqrt(2 sigma² tau). Without
it the known height turns the vertical accelerometer into a velocity sensor by the Eötvös term, and
the filter claims, in simulation even rightly, tens of metres after hours: no real vehicle has
that."""

LEAST_INFORMATION = -4.0
"""Of a likelihood, per unit of the navigator's own information. A posterior has less than its
prior by -1 at most; the navigator may have become less certain meanwhile."""


@dataclass(frozen=True, slots=True)
class FilterModel:
    """What the filter assumes about sensors and aids; the same for all runs."""

    noise: tuple[float, ...]
    """White noise densities of accelerometers (3; m/s²/sqrt(Hz)) and gyroscopes (3;
    rad/s/sqrt(Hz))."""
    initial_sigma: tuple[float, ...]
    """(15,) 1-sigma of the error state at the start."""
    dt: float
    """IMU interval, s."""
    height_sigma: float = 0.1
    """1-sigma of the known height, m; 0 = no height aid."""
    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0
    assumptions: ukf.Assumptions = field(init=False, repr=False, compare=False)
    """The same as the compiled filter takes it."""

    def __post_init__(self) -> None:
        weights = merwe_weights(self.alpha, self.beta, self.kappa)
        assumptions = ukf.Assumptions(self.dt, np.array(self.noise), self.height_sigma, weights)
        object.__setattr__(self, "assumptions", assumptions)

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> "FilterModel":
        """Return the model that knows what the scenario's simulation draws from."""
        grade, initial = GRADES[scenario.imu.grade], scenario.initial_error
        position, velocity = (
            max(initial.position, _POSITION_FLOOR),
            max(initial.velocity, _VELOCITY_FLOOR),
        )
        tilt, heading = max(initial.tilt, _ATTITUDE_FLOOR), max(initial.heading, _ATTITUDE_FLOOR)
        sigma = (position, position, 0.1, velocity, velocity, 0.01, tilt, tilt, heading)
        return cls(
            noise=(
                *grade.accelerometer_noise[:2],
                math.hypot(grade.accelerometer_noise[2], UNKNOWN_GRAVITY),
                *grade.gyroscope_noise,
            ),
            initial_sigma=(*sigma, *grade.accelerometer_bias, *grade.gyroscope_bias),
            dt=1.0 / scenario.imu.rate,
        )


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
    covariance: Array
    """(R, 15, 15) of the filter's error state (`isogal.inertial.error_state`)."""

    def __len__(self) -> int:
        return self.position.shape[0]

    @classmethod
    def start(cls, nav: NavState, model: FilterModel) -> "FilterState":
        """Return the state at the start: biases zero, covariance diagonal."""
        runs = len(nav)
        covariance = np.tile(np.diag(np.square(model.initial_sigma)), (runs, 1, 1))
        return cls(
            nav.position.copy(),
            nav.velocity.copy(),
            nav.attitude.copy(),
            np.zeros((runs, 3)),
            np.zeros((runs, 3)),
            covariance,
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
        )

    def arrays(self) -> tuple[Array, ...]:
        """Return all arrays, those of the mean first."""
        return (*self.nominal, self.covariance)

    def nominal_of(self, run: int) -> Nominal:
        """Return the mean of one run; it shares the arrays."""
        return Nominal(*(array[run] for array in self.nominal))

    def estimate_of(self, run: int) -> Estimate:
        """Return position, velocity and attitude of one run; they share the arrays."""
        return Estimate(self.position[run], self.velocity[run], self.attitude[run])


class FilterDivergenceError(RuntimeError):
    """The covariance lost positive definiteness: the filter's numbers can no longer be trusted."""


def propagate(
    state: FilterState,
    model: FilterModel,
    specific_force: Array,
    angular_rate: Array,
    height: Array,
) -> None:
    """Advance all runs over S intervals, in place.

    Parameters
    ----------
    specific_force, angular_rate : (R, S, 3) arrays
        Means over each interval, body axes.
    height : (S,) array
        Known height after each interval, m (used while model.height_sigma > 0).

    Raises
    ------
    FilterDivergenceError
        A covariance is no longer positive definite (not repaired in silence).
    """
    height = np.asarray(height, dtype=float)
    done = ukf.advance(
        state.nominal, state.covariance, specific_force, angular_rate, height, model.assumptions
    )
    steps = specific_force.shape[1]
    failed = [run for run, reached in enumerate(done.tolist()) if reached < steps]
    if failed:
        raise FilterDivergenceError(f"covariance of run(s) {failed} is not positive definite")


def update_information(
    state: FilterState, run: int, vector: Array, matrix: Array
) -> tuple[Array, float]:
    """Update one run with the likelihood of its horizontal error in information form, in place.

    Parameters
    ----------
    vector, matrix : (n,), (n, n) arrays
        log p = vector' x - x' matrix x / 2 of x = (north m, east m, v_north, v_east m/s), n = 4,
        or with attitude about north, east, down (rad), n = 7; estimate minus truth. Where the
        matrix is negative the estimate becomes less certain, by a factor of four in variance at
        most.

    Returns
    -------
    correction : (n,) array
        Change of the estimate.
    nis : float
        Normalised innovation squared of the part of x that the matrix informs on.

    Raises
    ------
    ValueError
        Not finite, or so negative that it cannot be what a posterior has less than its prior; the
        state is as it was.
    """
    if not (np.isfinite(vector).all() and np.isfinite(matrix).all()):
        raise ValueError("information is not finite")
    P, which = state.covariance[run], BATCH[: len(vector)]
    scale = np.sqrt(np.diag(P)[which])
    unit_free = 0.5 * (matrix + matrix.T) * scale[:, None] * scale  # m and m/s alike
    values, vectors = np.linalg.eigh(
        _bounded(unit_free, P[np.ix_(which, which)] / scale[:, None] / scale)
    )
    keep = np.abs(values) > 1e-12 * max(np.abs(values).max(), 1e-300)
    size, sign = np.sqrt(np.abs(values[keep])), np.sign(values[keep])
    # square root form: pseudo-measurements H xi = z with noise of variance J = +-1, H' J H =
    # matrix
    H = (vectors[:, keep] * size).T / scale
    z = sign * ((vectors[:, keep] / size).T @ (vector * scale))
    gain = P[:, which] @ H.T
    innovation = H @ gain[which] + np.diag(sign)
    solved = np.linalg.solve(innovation, np.column_stack([z, gain.T]))
    error = -gain @ solved[:, 0]  # xi is estimate minus truth, the correction its negative
    reduced = P - gain @ solved[:, 1:]
    state.covariance[run] = 0.5 * (reduced + reduced.T)
    move(state.nominal_of(run), error)
    told = sign > 0.0
    return error[which], float(z[told] @ np.linalg.solve(innovation[np.ix_(told, told)], z[told]))


def _bounded(matrix: Array, covariance: Array) -> Array:
    """Return the information matrix (n, n) such that the update makes no variance more than four
    times as large."""
    factor = np.linalg.cholesky(covariance)
    values, vectors = np.linalg.eigh(factor.T @ matrix @ factor)
    if values[0] < LEAST_INFORMATION:
        raise ValueError("information matrix is too negative")
    if values[0] >= -0.75:
        return matrix
    back = np.linalg.solve(factor.T, vectors)
    return np.asarray((back * np.maximum(values, -0.75)) @ back.T, dtype=np.float64)


def update_position(
    state: FilterState, run: int, latitude: float, longitude: float, covariance: Array
) -> tuple[Array, float]:
    """Update one run with a horizontal fix, in place.

    Parameters
    ----------
    latitude, longitude : float
        Fix, rad.
    covariance : (2, 2) array
        Of the fix, north-east, m².

    Returns
    -------
    innovation : (2,) array
        Fix minus prediction, north, east, m.
    nis : float
        Normalised innovation squared.

    Raises
    ------
    ValueError
        The fix is not finite or its covariance not positive definite; the state is as it was.
    """
    if not (
        math.isfinite(latitude) and math.isfinite(longitude) and np.isfinite(covariance).all()
    ):
        raise ValueError("fix is not finite")
    if not (
        covariance[0, 0] > 0.0
        and covariance[0, 0] * covariance[1, 1] > covariance[0, 1] * covariance[1, 0]
    ):
        raise ValueError("covariance of the fix is not positive definite")
    north, east, nis = ukf.update_position(
        state.nominal_of(run), state.covariance[run], latitude, longitude, covariance
    )
    if math.isnan(nis):
        raise ValueError("innovation covariance is not positive definite")
    return np.array([north, east]), nis


def widen(state: FilterState, run: int, covariance: Array) -> None:
    """Add a covariance (7, 7) to that of one run's batch states, in place: the navigator was found
    lost."""
    state.covariance[run][np.ix_(BATCH, BATCH)] += covariance


@dataclass(frozen=True, slots=True, eq=False)
class NavigatorRun:
    """One of the runs of a state (a `isogal.fusion.fix.FixTarget`)."""

    state: FilterState
    run: int

    def widen(self, covariance: Array) -> None:
        """See `widen`."""
        widen(self.state, self.run, covariance)

    def update_information(self, vector: Array, matrix: Array) -> tuple[Array, float]:
        """See `update_information`."""
        return update_information(self.state, self.run, vector, matrix)

    def update_position(
        self, latitude: float, longitude: float, covariance: Array
    ) -> tuple[Array, float]:
        """See `update_position`."""
        return update_position(self.state, self.run, latitude, longitude, covariance)
