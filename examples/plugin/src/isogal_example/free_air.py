"""The field `free-air`: a marine gravimeter over a map of free-air gravity anomalies.

The free-air anomaly is gravity on the geoid less normal gravity on the ellipsoid
(Hofmann-Wellenhof and Moritz, Physical Geodesy, 2006); maps of it cover the oceans. A reading is
reduced as that of a disturbance is, with the vehicle's height above the sea instead of that above
the ellipsoid."""

from isogal.fields.measured import MeasuredField
from isogal.sensors.gravimeter import DisturbanceReduction

FREE_AIR = MeasuredField(
    name="free-air",
    instrument="gravimeter",
    quantity="gravity_anomaly",
    unit="m/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: DisturbanceReduction(),
)
