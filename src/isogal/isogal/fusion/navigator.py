"""The navigator: the unscented filter of many runs at once."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.fusion import ukf
from isogal.inertial.rotations import multiply, to_rotation_vector
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
    """(R, 15, 15) of the error state of `isogal.fusion.ukf`."""

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
        return self.covariance[:, ukf.BATCH[:, None], ukf.BATCH]

    def arrays(self) -> tuple[Array, ...]:
        """Return the arrays in the order the kernels take them."""
        return (
            self.position,
            self.velocity,
            self.attitude,
            self.accelerometer_bias,
            self.gyroscope_bias,
            self.covariance,
        )


class FilterDivergenceError(RuntimeError):
    """The covariance lost positive definiteness: the filter's numbers can no longer be trusted."""


def kernel_weights(model: FilterModel) -> tuple[float, float, float, float]:
    """Return the sigma point weights as the kernels take them."""
    w = ukf.unscented_weights(ukf.N, model.alpha, model.beta, model.kappa)
    return w.spread, w.mean_centre, w.covariance_centre, w.other


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
    done = ukf.advance(
        *state.arrays(), specific_force, angular_rate, model.dt, np.asarray(model.noise), kernel_weights(model),
        np.asarray(height, dtype=float), model.height_sigma,
    )  # fmt: skip
    failed = np.flatnonzero(done < specific_force.shape[1])
    if failed.size:
        raise FilterDivergenceError(
            f"covariance of run(s) {failed.tolist()} is not positive definite"
        )


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
    P, which = state.covariance[run], ukf.BATCH[: len(vector)]
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
    ukf.move(*(array[run] for array in state.arrays()[:5]), error)
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
    parts = [array[run] for array in state.arrays()]
    north, east, nis = ukf.update_position(
        *parts,
        latitude,
        longitude,
        covariance[0, 0],
        0.5 * (covariance[0, 1] + covariance[1, 0]),
        covariance[1, 1],
    )
    if math.isnan(nis):
        raise ValueError("innovation covariance is not positive definite")
    return np.array([north, east]), nis


def widen(state: FilterState, run: int, sigma: tuple[float, float, float]) -> None:
    """Add a 1-sigma to one run's horizontal position (m), velocity (m/s) and tilt (rad), in place:
    the navigator was found lost."""
    for first, one in zip((0, 3, 6), sigma, strict=True):
        for axis in (first, first + 1):
            state.covariance[run, axis, axis] += one * one


def jump_between(before: FilterState, after: FilterState, run: int) -> Array:
    """Return (7,) how far one run's estimate moved: north, east m, v_north, v_east m/s, attitude
    about north, east, down rad."""
    shift = horizontal_difference(
        after.position[run, 0],
        after.position[run, 1],
        before.position[run, 0],
        before.position[run, 1],
    )
    w, x, y, z = before.attitude[run]
    turn = to_rotation_vector(*multiply(*after.attitude[run], w, -x, -y, -z))
    return np.array([*shift, *(after.velocity[run, :2] - before.velocity[run, :2]), *turn])
