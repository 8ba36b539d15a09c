"""What all aids of a simulated vehicle measure."""

from collections.abc import Sequence

from isogal.scenario import Gnss, HeadingAid, Height, PositionAid, Truth, Velocity
from isogal.scenario.aids import AnyAid, SatellitePosition
from isogal.sensors.barometer import simulate_heights
from isogal.sensors.heading_aid import simulate_headings
from isogal.sensors.position_aid import AidReadings, simulate_positions
from isogal.sensors.satellites import simulate_satellites
from isogal.sensors.trajectory import Trajectory
from isogal.sensors.velocity_aid import simulate_velocities


def simulate_aids(
    truth: Truth, trajectory: Trajectory, runs: Sequence[int]
) -> tuple[AidReadings, ...]:
    """Return what the aids of some runs measure, as they really are, in the order of
    `Settings.aids`."""
    drawn = trajectory, truth.seed, runs
    satellites = iter(simulate_satellites(truth.gnss, *drawn) if truth.gnss.used else ())

    def readings(aid: AnyAid) -> AidReadings:
        match aid:
            case Height():
                return simulate_heights(aid, *drawn)
            case Velocity():
                return simulate_velocities(aid, *drawn, truth.velocity_aids)
            case SatellitePosition() | Gnss():
                return next(satellites)
            case PositionAid():
                return simulate_positions(aid, *drawn)
            case HeadingAid():
                return simulate_headings(aid, *drawn, truth.magnetometer.epoch)

    return tuple(map(readings, truth.aids))
