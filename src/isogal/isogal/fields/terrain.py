"""The height of the terrain, measured by an altimeter as the clearance above it."""

from isogal.fields.measured import MeasuredField
from isogal.sensors.altimeter import TerrainReduction

TERRAIN = MeasuredField(
    name="terrain",
    instrument="altimeter",
    quantity="height",
    unit="m",
    least_sigma=1e-4,
    sign=-1.0,
    reduction=lambda scenario: TerrainReduction(scenario.altimeter),
)
