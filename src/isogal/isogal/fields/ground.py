"""The height of the terrain, measured by the barometer of a vehicle that is on the ground.

A vehicle that stands or drives on the ground is at the height of the terrain below it, plus that
of the instrument above the wheels. Its barometer's height is therefore a reading of the terrain,
whatever the navigator takes as its own height; what the sea-level pressure, the instrument's place
in the vehicle and the datum of the map are off by is one constant (`matcher.bias_sigma`), what the
weather does while the vehicle is on its way is slow (`gravimeter.correlated_sigma` and
`correlation_time`, or `gravimeter.bias_walk`), and roads that are not where the map's cells have
their ground are errors of the map."""

from isogal.fields.measured import MeasuredField
from isogal.sensors.reduction import AsRead

GROUND = MeasuredField(
    name="ground",
    instrument="ground barometer",
    quantity="height",
    unit="m",
    least_sigma=1e-3,
    sign=1.0,
    reduction=lambda scenario: AsRead(),
)
