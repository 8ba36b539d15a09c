"""A simulated vehicle: the true route, what its inertial sensors say, and the unaided INS."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.fields.gravity_vector import sensed_gravity
from isogal.fields.known_gravity import known_gravity
from isogal.inertial.rotations import matrix
from isogal.scenario import Assumed, Truth
from isogal.sensors.barometer import simulate_heights
from isogal.sensors.imu import ImuData, simulate_imu, simulate_samples
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.ins_solution import said, unaided_solution
from isogal.sensors.position_aid import AidReadings
from isogal.sensors.simulated_aids import simulate_aids
from isogal.sensors.trajectory import Trajectory, build_trajectory


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedVehicle:
    """One run of K steps."""

    trajectory: Trajectory
    states: Array
    """(K + 1, 10) true latitude, longitude (rad), height (m), velocity NED (m/s), quaternion FRD
    to NED."""
    imu: ImuData
    """What the sensors measure over the steps of a navigator."""
    samples: Array
    """(K, n, 6) specific force (m/s²) and angular rate (rad/s) of the n IMU samples of each
    step."""
    unaided: Array
    """(K + 1, 2) rad, latitude and longitude of the unaided INS."""
    solution: Array | None
    """(K + 1, 10) what the INS says (`isogal.inertial.inverse.COLUMNS`), where it gives its
    solution in place of samples; None = it gives samples."""
    aids: tuple[AidReadings, ...]
    """Of one run, in the order of `Settings.aids`."""
    heights: AidReadings | None
    """Of the section `height`; None = it has no sensor."""
    turn_rate: Array
    """(K + 1, 3) rad/s, FRD, true angular rate relative to the Earth; the mean over the interval
    before."""

    def __len__(self) -> int:
        return len(self.trajectory)


def simulate_vehicle(assumed: Assumed, truth: Truth, run: int) -> SimulatedVehicle:
    """Return one run, as it really is.

    Parameters
    ----------
    assumed : Assumed
        What the unaided INS knows of horizontal gravity.
    truth : Truth
    run : int

    Raises
    ------
    InputError
        The route cannot be driven, or its map does not say what gravity is there.
    """
    trajectory = build_trajectory(truth)
    gravity = sensed_gravity(truth.gravity_field, trajectory, [run])
    imu = simulate_imu(truth, trajectory, [run], gravity)
    start = draw_initial_state(truth.initial_error, trajectory, truth.seed, [run])
    given = truth.ins.gives_solution
    known = None if given else known_gravity(assumed.gravity_field, trajectory).compensation
    ins = unaided_solution(start, trajectory, imu, truth.samples_per_step > 1, known)
    if given:
        ins = said(truth.ins, ins)
    states = np.hstack([trajectory.position, trajectory.velocity, trajectory.attitude])
    samples = simulate_samples(
        truth, trajectory, run, None if gravity is None else gravity[0]
    ).reshape(len(trajectory), -1, 6)
    heights = None
    if truth.height.measured:
        heights = simulate_heights(truth.height, trajectory, truth.seed, [run])
    return SimulatedVehicle(
        trajectory,
        states,
        imu,
        samples,
        ins[0, :, :2],
        ins[0] if given else None,
        simulate_aids(truth, trajectory, [run]),
        heights,
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
