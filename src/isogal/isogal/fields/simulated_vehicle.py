"""A simulated vehicle: the true route, what its inertial sensors say, and the unaided INS."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.fields.gravity_vector import sensed_gravity
from isogal.fields.known_gravity import known_gravity
from isogal.inertial.rotations import matrix
from isogal.inertial.strapdown import propagate
from isogal.scenario import Scenario
from isogal.sensors.barometer import simulate_heights
from isogal.sensors.imu import ImuData, simulate_imu, simulate_samples
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.satellites import SatelliteFixes, simulate_satellites
from isogal.sensors.trajectory import Trajectory, build_trajectory
from isogal.sensors.velocity_aid import simulate_velocities


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedVehicle:
    """One run of K steps."""

    trajectory: Trajectory
    states: Array
    """(K + 1, 10) true latitude, longitude (rad), height (m), velocity NED (m/s), quaternion FRD
    to NED."""
    imu: ImuData
    """What the navigator gets over the steps."""
    samples: Array
    """(K, n, 6) specific force (m/s²) and angular rate (rad/s) of the n IMU samples of each
    step."""
    unaided: Array
    """(K + 1, 2) rad, latitude and longitude of the unaided INS."""
    height: Array | None
    """(K,) m, what the height sensor reads at the end of each step, NaN = nothing; None = there is
    none."""
    velocity: Array | None
    """(K, 3) m/s, FRD, what the velocity aid reads, likewise."""
    satellites: SatelliteFixes | None
    """Of one run: what the satellite receiver gives; None = there is none."""
    turn_rate: Array
    """(K + 1, 3) rad/s, FRD, true angular rate relative to the Earth; the mean over the interval
    before."""

    def __len__(self) -> int:
        return len(self.trajectory)


def simulate_vehicle(scenario: Scenario, run: int) -> SimulatedVehicle:
    """Return one run of a scenario, as it really is.

    Raises
    ------
    InputError
        The route cannot be driven, or its map does not say what gravity is there.
    """
    truth, trajectory = scenario.true, build_trajectory(scenario)
    of_gravity = scenario.gravity_field
    gravity = sensed_gravity(of_gravity.true, trajectory, [run])
    imu = simulate_imu(truth, trajectory, [run], gravity)
    compensation = known_gravity(of_gravity, trajectory).compensation
    start = draw_initial_state(truth, trajectory, [run])
    _, track = propagate(
        start,
        imu.specific_force,
        imu.angular_rate,
        trajectory.dt,
        trajectory.height,
        compensation,
        history=True,
        preintegrated=scenario.samples_per_step > 1,
    )
    states = np.column_stack(
        [
            trajectory.latitude,
            trajectory.longitude,
            trajectory.height,
            trajectory.velocity,
            trajectory.attitude,
        ]
    )
    unaided = np.concatenate([start.position[:, :2], track[0]])
    samples = simulate_samples(
        truth, trajectory, run, None if gravity is None else gravity[0]
    ).reshape(len(trajectory), -1, 6)
    height = simulate_heights(truth, trajectory, [run])[0] if truth.height.measured else None
    aid = truth.velocity.kind != "none"
    velocity = simulate_velocities(truth, trajectory, [run])[0] if aid else None
    satellites = simulate_satellites(truth, trajectory, [run]) if truth.gnss.used else None
    return SimulatedVehicle(
        trajectory,
        states,
        imu,
        samples,
        unaided,
        height,
        velocity,
        satellites,
        _turn_rate(trajectory),
    )


def _turn_rate(trajectory: Trajectory) -> Array:
    """Return the angular rate relative to the Earth (K + 1, 3) FRD: the inertial one without the
    Earth's rotation."""
    to_body = np.swapaxes(matrix(trajectory.attitude[1:]), 1, 2)
    c, s = np.cos(trajectory.latitude[1:]), np.sin(trajectory.latitude[1:])
    of_earth = EARTH_RATE * np.stack([c, np.zeros_like(c), -s], axis=-1)
    rate = trajectory.angular_rate - np.einsum("kij,kj->ki", to_body, of_earth)
    return np.concatenate([rate[:1], rate])
