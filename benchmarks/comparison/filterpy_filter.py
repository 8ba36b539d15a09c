"""The unscented filter: Isogal's compiled one and filterpy's, on the same IMU readings.

filterpy's filter is set up as a user of it would, with the navigator's states as they are: it is
faster than `isogal.fusion.reference`, which follows the compiled filter step by step."""

import time

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from numba import njit

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fusion import sigma_points
from isogal.fusion.assumed import filter_model
from isogal.fusion.model import FilterModel
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_rotation_vector, to_rotation_vector
from isogal.inertial.strapdown import MEANS, step
from isogal.scenario import Scenario
from isogal.sensors.imu import simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory

STEPS = 400
"""Steps that filterpy's filter is timed over."""
REPEATS = 20


class FilterpyNavigator:
    """The same navigator built from filterpy: state latitude, longitude, height, velocity,
    rotation vector, biases."""

    def __init__(self, state: FilterState, model: FilterModel) -> None:
        points = MerweScaledSigmaPoints(15, model.alpha, model.beta, model.kappa)
        self.filter = UnscentedKalmanFilter(
            15, 1, model.dt, hx=lambda x: x[2:3], fx=self.move, points=points
        )
        north, east = metres_per_radian(state.position[0], state.position[2])
        # error states in metres to states in rad
        scale = np.array([1 / north, 1 / east, -1.0, *np.ones(12)])
        turn = to_rotation_vector(*state.attitude)
        biases = np.concatenate([state.accelerometer_bias, state.gyroscope_bias])
        self.filter.x = np.concatenate([state.position, state.velocity, turn, biases])
        self.filter.P = state.covariance * scale * scale[:, None]
        self.filter.R = np.array([[model.height_sigma**2]])
        noise = np.square(model.noise) * model.dt
        self.filter.Q = np.diag(np.concatenate([np.zeros(3), noise, np.zeros(6)]))
        self.force = self.rate = np.zeros(3)

    def move(self, x: Array, dt: float) -> Array:
        f, w = self.force - x[9:12], self.rate - x[12:15]
        start = (*x[:3],), (*x[3:6],), from_rotation_vector(*x[6:9])
        position, velocity, attitude = step(*start, (*f,), (*w,), (0.0, 0.0, 0.0), dt, MEANS)
        return np.concatenate([position, velocity, to_rotation_vector(*attitude), x[9:]])

    def advance(self, force: Array, rate: Array, height: float) -> None:
        self.force, self.rate = force, rate
        self.filter.predict()
        self.filter.update(np.array([height]))


def measure_filters(scenario: Scenario) -> dict[str, float]:
    """CPU seconds per simulated second of both filters, and how far they end apart (m)."""
    trajectory = build_trajectory(scenario)
    steps = min(STEPS, len(trajectory))
    imu = simulate_imu(scenario.true, trajectory, [0])
    force, rate = imu.specific_force[0, :steps], imu.angular_rate[0, :steps]
    height = trajectory.height[1 : steps + 1]
    model = filter_model(scenario)
    drawn = draw_initial_state(scenario.true, trajectory, [0])
    begin = Estimate(drawn.position[0], drawn.velocity[0], drawn.attitude[0])
    start = FilterState.start(begin, model)
    ours, theirs = start.copy(), FilterpyNavigator(start, model)
    propagate(ours, model, force, rate, height)
    for _ in range(5):  # first calls compile
        theirs.move(theirs.filter.x, model.dt)
    since = time.thread_time()
    for k in range(steps):
        theirs.advance(force[k], rate[k], float(height[k]))
    seconds = time.thread_time() - since
    apart = (ours.position[:2] - theirs.filter.x[:2]) * np.array(
        metres_per_radian(ours.position[0])
    )
    if not np.hypot(*apart) < 1.0:
        raise SystemExit(
            f"filterpy's filter ends {np.hypot(*apart):.1f} m from ours: not the same work"
        )
    since = time.thread_time()
    for _ in range(REPEATS):
        propagate(start.copy(), model, force, rate, height)
    mine = (time.thread_time() - since) / REPEATS
    sigma = strapdown_share(start, force[0], rate[0], model.dt)
    simulated = steps * model.dt
    return {
        "filterpy": seconds / simulated,
        "isogal": mine / simulated,
        "strapdown_in_filter": sigma / model.dt,
        "apart_m": float(np.hypot(*apart)),
    }


@njit(nogil=True, error_model="numpy")
def _sigma_points_through_strapdown(count, nominal, force, rate, dt):
    points = np.full((sigma_points.CORE, sigma_points.LANES), 1e-9)
    pushes = np.zeros((9, sigma_points.LANES))
    normal = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    ends = np.empty((10, sigma_points.LANES))
    for _ in range(count):
        sigma_points.propagate_points(
            nominal, force, rate, normal, dt, MEANS, points, pushes, ends
        )
    return ends


def strapdown_share(
    state: FilterState, force: Array, rate: Array, dt: float, count: int = 20000
) -> float:
    """CPU seconds that the strapdown of all sigma points takes in one step of the filter."""
    arguments = (state.nominal, force, rate, dt)
    _sigma_points_through_strapdown(1, *arguments)
    start = time.thread_time()
    _sigma_points_through_strapdown(count, *arguments)
    return (time.thread_time() - start) / count
