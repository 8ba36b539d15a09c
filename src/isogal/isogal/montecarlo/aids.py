"""Sensors of height and velocity in runs of the engine."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.fusion.aiding import update_velocity
from isogal.fusion.model import FilterModel
from isogal.fusion.navigator import propagate
from isogal.fusion.state import FilterState
from isogal.scenario import Scenario
from isogal.sensors.barometer import simulate_heights
from isogal.sensors.imu import ImuData
from isogal.sensors.trajectory import Trajectory
from isogal.sensors.velocity_aid import simulate_velocities


class Aids:
    """Inertial data, heights and velocities of R runs, which the navigators advance with.

    Parameters
    ----------
    scenario : Scenario
        What is simulated is what is true of it; the filter assumes what it says.
    trajectory : Trajectory
    runs : sequence of int
    model : FilterModel
    imu : ImuData
    """

    def __init__(
        self,
        scenario: Scenario,
        trajectory: Trajectory,
        runs: Sequence[int],
        model: FilterModel,
        imu: ImuData,
    ) -> None:
        truth = scenario.true
        self._imu, self._model, self._told = imu, model, scenario.velocity
        self._height: Array = trajectory.height[1:]
        if truth.height.measured:
            self._height = simulate_heights(truth, trajectory, runs)
        self._velocity: Array | None = None
        if truth.velocity.kind != "none":
            self._velocity = simulate_velocities(truth, trajectory, runs)

    def advance(self, state: FilterState, which: Any, first: int, last: int) -> None:
        """Advance some of the runs, whose states are given, from one IMU interval to another."""
        if self._velocity is None:
            self._propagate(state, which, first, last)
            return
        readings = self._velocity[which, first:last]
        start = first
        for k in np.flatnonzero(np.isfinite(readings).any(axis=(0, 2))).tolist():
            self._propagate(state, which, start, first + k + 1)
            start = first + k + 1
            for row in range(len(state)):
                update_velocity(state, self._model, row, self._told, readings[row, k])
        if start < last:
            self._propagate(state, which, start, last)

    def _propagate(self, state: FilterState, which: Any, first: int, last: int) -> None:
        height = self._height
        propagate(
            state,
            self._model,
            self._imu.specific_force[which, first:last],
            self._imu.angular_rate[which, first:last],
            height[first:last] if height.ndim == 1 else height[which, first:last],
        )
