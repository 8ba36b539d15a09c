"""What all aids of a simulated vehicle measure."""

from collections.abc import Sequence
from typing import NamedTuple

from isogal.arrays import Array
from isogal.scenario import Truth
from isogal.sensors.barometer import simulate_heights
from isogal.sensors.heading_aid import Headings, simulate_headings
from isogal.sensors.position_aid import Positions, simulate_positions
from isogal.sensors.satellites import SatelliteFixes, simulate_satellites
from isogal.sensors.trajectory import Trajectory
from isogal.sensors.velocity_aid import simulate_velocities


class SimulatedAids(NamedTuple):
    """What the aids of R runs measure over K steps; None = there is no such aid."""

    height: Array | None
    """(R, K) m, at the end of each step, NaN = nothing."""
    heights: tuple[Array, ...]
    """Likewise, of each entry of the scenario's list."""
    velocities: tuple[Array, ...]
    """(R, K, 3) m/s, FRD, likewise, of each of `Settings.velocity_aids`."""
    satellites: SatelliteFixes | None
    positions: tuple[Positions, ...]
    """Of each entry of the scenario's list."""
    headings: tuple[Headings, ...]
    """Likewise."""


def simulate_aids(truth: Truth, trajectory: Trajectory, runs: Sequence[int]) -> SimulatedAids:
    """Return what the aids of some runs measure, as they really are."""
    scene = trajectory, runs
    return SimulatedAids(
        simulate_heights(truth, truth.height, *scene) if truth.height.measured else None,
        tuple(simulate_heights(truth, aid, *scene) for aid in truth.heights or ()),
        tuple(simulate_velocities(truth, aid, *scene) for aid in truth.velocity_aids),
        simulate_satellites(truth, *scene) if truth.gnss.used else None,
        tuple(simulate_positions(truth, aid, *scene) for aid in truth.positions or ()),
        tuple(simulate_headings(truth, aid, *scene) for aid in truth.headings or ()),
    )
