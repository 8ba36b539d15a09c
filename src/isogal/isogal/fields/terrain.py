"""The height of the terrain, measured by an altimeter as the clearance above it, or by the
soundings of several beams."""

from isogal.errors import InputError
from isogal.fields.measured import MeasuredField
from isogal.scenario import Scenario
from isogal.sensors.altimeter import TerrainReduction
from isogal.sensors.beams import BeamReduction
from isogal.sensors.lag import Lag
from isogal.sensors.reduction import Reduction


def _reduction(scenario: Scenario) -> Reduction:
    if not scenario.altimeter.sounds:
        return TerrainReduction(scenario.altimeter)
    for name, section in (("", scenario), ("truth.", scenario.world)):
        late = Lag.of(section.gravimeter).mean > 0.0 or section.gravimeter.delay_sigma > 0.0
        if late:
            raise InputError(
                f"{name}gravimeter.delay: an altimeter with several beams or a scale error cannot"
                " be late, nor have a filter"
            )
    return BeamReduction(scenario.altimeter)


TERRAIN = MeasuredField(
    name="terrain",
    instrument="altimeter",
    quantity="height",
    unit="m",
    least_sigma=1e-4,
    sign=-1.0,
    reduction=_reduction,
)
