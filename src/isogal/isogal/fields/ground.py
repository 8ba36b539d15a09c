"""The height of the terrain, measured by the barometer of a vehicle that is on the ground."""

from isogal.fields.measured import MeasuredField
from isogal.sensors.ground_height import GroundHeight

GROUND = MeasuredField(
    name="ground",
    instrument="ground barometer",
    quantity="height",
    unit="m",
    least_sigma=1e-3,
    sign=1.0,
    reduction=lambda scenario: GroundHeight(),
)
