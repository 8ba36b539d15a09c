"""A short flight with its IMU data, and states of the filter, for the tests of fusion, batching
and the engine."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from helpers.batches import ORIGIN
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fusion.assumed import filter_model
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.scenario import Gravity, Route, Scenario
from isogal.sensors.imu import simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import Trajectory, build_trajectory

SIGMA = np.array(
    [300.0, 200.0, 3.0, 0.3, 0.2, 0.05, 1e-4, 1e-4, 1e-3, 1e-5, 1e-5, 1e-6, 1e-9, 1e-9, 1e-8]
)
"""Of a filter's 15 states, SI."""
ROUTE = Route(start=tuple(np.degrees(ORIGIN)), end=(-36.3, 147.4), duration=600.0)


@dataclass(frozen=True)
class Flight:
    trajectory: Trajectory
    force: np.ndarray
    """(K, 3) m/s²."""
    rate: np.ndarray
    """(K, 3) rad/s."""
    model: FilterModel
    start: FilterState

    @property
    def height(self) -> np.ndarray:
        """(K,) m, at the end of each interval."""
        return self.trajectory.height[1:]

    def samples(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Specific force, angular rate and height of some intervals, as `propagate` takes them."""
        return self.force[first:last], self.rate[first:last], self.height[first:last]

    def fix(self, stamp: int, north: float, east: float) -> tuple[float, float]:
        """Latitude and longitude (rad) of a place some metres from the truth at a stamp of a 1 Hz
        flight."""
        metres = metres_per_radian(self.trajectory.latitude[stamp])
        return (
            self.trajectory.latitude[stamp] + north / metres[0],
            self.trajectory.longitude[stamp] + east / metres[1],
        )


def start_of(scenario: Scenario, trajectory: Trajectory, run: int = 0) -> Estimate:
    """Where the navigator of a run starts."""
    drawn = draw_initial_state(scenario.true.initial_error, trajectory, scenario.seed, [run])
    return Estimate(drawn.position[0], drawn.velocity[0], drawn.attitude[0])


def fly(run: int = 0, **keys) -> Flight:
    scenario = Scenario(**({"route": ROUTE, "gravity": Gravity(field="normal")} | keys))
    trajectory = build_trajectory(scenario)
    model = filter_model(scenario)
    start = FilterState.start(start_of(scenario, trajectory, run), model)
    imu = simulate_imu(scenario.true, trajectory, [run])
    return Flight(trajectory, imu.specific_force[0], imu.angular_rate[0], model, start)


def identical(a: FilterState, b: FilterState) -> bool:
    same = all(np.array_equal(x, y) for x, y in zip(a.arrays(), b.arrays(), strict=True))
    return same and a.contradicted == b.contradicted


def error_between(after: FilterState, before: FilterState) -> np.ndarray:
    """(15 + M,) error state that leads from one state to another."""
    latitude, _, height = before.position
    new, old = (Rotation.from_quat(one.attitude, scalar_first=True) for one in (after, before))
    return np.concatenate(
        [
            (after.position - before.position) * [*metres_per_radian(latitude, height), -1.0],
            after.velocity - before.velocity,
            (new * old.inv()).as_rotvec(),
            after.accelerometer_bias - before.accelerometer_bias,
            after.gyroscope_bias - before.gyroscope_bias,
            after.auxiliary - before.auxiliary,
        ]
    )


def assert_close(a: FilterState, b: FilterState, mean: float, covariance: float) -> None:
    """Whether two states agree: their means within a share of the 1-sigmas of the second, and
    their covariances in units of these."""
    sigma = np.sqrt(np.diag(b.covariance))
    np.testing.assert_allclose(error_between(a, b) / sigma, 0.0, atol=mean)
    unlike = (a.covariance - b.covariance) / np.outer(sigma, sigma)
    np.testing.assert_allclose(unlike, 0.0, atol=covariance)


def random_covariance(sigma: np.ndarray, seed: int = 0) -> np.ndarray:
    """Full, well-scaled positive definite covariance with about these 1-sigmas."""
    n = len(sigma)
    root = np.eye(n) + 0.3 * np.random.default_rng(seed).standard_normal((n, n))
    return root @ root.T * sigma * sigma[:, None]
