"""The height of the terrain, measured by an altimeter as the clearance above it, or by the
soundings of several beams."""

from isogal.fields.measured import MeasuredField
from isogal.scenario import Settings
from isogal.sensors.altimeter import BeamReduction, TerrainReduction
from isogal.sensors.reduction import Reduction


def _reduction(settings: Settings) -> Reduction:
    if not settings.altimeter.sounds:
        return TerrainReduction(settings.altimeter)
    return BeamReduction(settings.altimeter)


TERRAIN = MeasuredField(
    name="terrain",
    instrument="altimeter",
    quantity="height",
    unit="m",
    least_sigma=1e-4,
    sign=-1.0,
    reduction=_reduction,
)
