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
    velocity: Array | None
    """(R, K, 3) m/s, FRD, likewise."""
    satellites: SatelliteFixes | None
    positions: tuple[Positions, ...]
    """Of each entry of the scenario's list."""
    headings: tuple[Headings, ...]
    """Likewise."""


def simulate_aids(truth: Truth, trajectory: Trajectory, runs: Sequence[int]) -> SimulatedAids:
    """Return what the aids of some runs measure, as they really are."""
    return SimulatedAids(
        simulate_heights(truth, trajectory, runs) if truth.height.measured else None,
        simulate_velocities(truth, trajectory, runs) if truth.velocity.kind != "none" else None,
        simulate_satellites(truth, trajectory, runs) if truth.gnss.used else None,
        tuple(simulate_positions(truth, aid, trajectory, runs) for aid in truth.positions or ()),
        tuple(simulate_headings(truth, aid, trajectory, runs) for aid in truth.headings or ()),
    )
