"""The readings of one field in runs of the engine."""

from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import true_map
from isogal.fields.simulator import ReadingSimulator, compensated
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import matrix
from isogal.maps.channels import RouteMap
from isogal.scenario import Scenario
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import Trajectory


class FieldRuns:
    """Simulated readings of R runs.

    Parameters
    ----------
    scenario : Scenario
        Of this field alone (`Scenario.each_field`).
    trajectory : Trajectory
    field_map : RouteMap
    runs : sequence of int
    every : int
        The engine's scans from one of its own to the next.

    Raises
    ------
    InputError
        See `isogal.fields.simulator.true_readings`.
    """

    def __init__(
        self,
        scenario: Scenario,
        trajectory: Trajectory,
        field_map: RouteMap,
        runs: Sequence[int],
        every: int = 1,
    ) -> None:
        self.scenario, self.field_map, self._every = scenario, field_map, every
        source = true_map(scenario, trajectory, field_map)
        readings = ReadingSimulator(scenario.true, trajectory, source, runs)
        self._felt = compensated(scenario, trajectory, readings)
        self._reduction = measured_field(scenario).reduction(scenario)

    def reduced(self, scan: int, state: FilterState) -> Array | None:
        """Return the readings (R,) or (R, C) at a scan of the engine, counted from 1, reduced with
        the navigators' states; None where this field has no scan there."""
        own, rest = divmod(scan, self._every)
        if rest:
            return None
        position, velocity = state.position, state.velocity
        estimate = State(
            position[:, 0],
            position[:, 1],
            position[:, 2],
            velocity[:, 0],
            velocity[:, 1],
            matrix(state.attitude),
        )
        return np.asarray(self._reduction.reduce(self._felt[:, own - 1], estimate))
