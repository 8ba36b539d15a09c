"""The solution of an INS, simulated (docs/mathematics.md, section 3.19).

The INS is one of its own: it integrates what its sensors measure from the start that is drawn
for it, takes off normal gravity only, and holds its height by a sensor, as every INS does."""

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import Estimate
from isogal.inertial.gravity import Compensation
from isogal.inertial.inverse import level_attitude
from isogal.inertial.rotations import from_angles, matrix, to_angles
from isogal.inertial.strapdown import propagate
from isogal.scenario import Ins
from isogal.sensors.imu import ImuData
from isogal.sensors.trajectory import Trajectory


def unaided_solution(
    start: Estimate,
    trajectory: Trajectory,
    imu: ImuData,
    preintegrated: bool,
    compensation: Compensation | None = None,
) -> Array:
    """Return (R, K + 1, 10) the states of unaided INSs (`isogal.inertial.inverse.COLUMNS`) at the
    ends of the trajectory's steps.

    Parameters
    ----------
    start : Estimate
        Of R runs.
    trajectory : Trajectory
    imu : ImuData
        What their sensors measure.
    preintegrated : bool
        See `isogal.inertial.strapdown.propagate`.
    compensation : Compensation, optional
        Horizontal gravity that the strapdown takes off.
    """
    first = np.concatenate([start.position, start.velocity, start.attitude], axis=1)
    _, track = propagate(
        start,
        imu.specific_force,
        imu.angular_rate,
        trajectory.dt,
        trajectory.height,
        compensation,
        history=True,
        preintegrated=preintegrated,
    )
    return np.concatenate([first[:, None], track], axis=1)


def said(ins: Ins, solution: Array) -> Array:
    """Return a solution (R, K + 1, 10) as an INS says it: to its last digit, and with the course
    of a level vehicle where it has no attitude."""
    solution = solution.copy()
    if (last := ins.position_resolution) > 0.0:
        north, east = metres_per_radian(solution[:, :1, 0], solution[:, :1, 2])
        for column, digit in ((0, last / north), (1, last / east), (2, last)):
            solution[..., column] = np.round(solution[..., column] / digit) * digit
    if (last := ins.velocity_resolution) > 0.0:
        solution[..., 3:6] = np.round(solution[..., 3:6] / last) * last
    if not ins.attitude:
        solution[..., 6:] = [level_attitude(velocity) for velocity in solution[..., 3:6]]
    elif (last := ins.angle_resolution) > 0.0:
        flat = solution.reshape(-1, solution.shape[-1])
        for row in flat:
            row[6:] = from_angles(*np.round(np.array(to_angles(matrix(row[6:]))) / last) * last)
    return solution
