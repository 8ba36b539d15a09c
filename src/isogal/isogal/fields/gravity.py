"""Gravity and the gravity disturbance, measured by a gravimeter."""

from isogal.fields.measured import MeasuredField
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction

_LARGEST = 1e-2
"""m/s²: 1000 mGal, as much as the largest disturbances of the Earth."""

GRAVITY = MeasuredField(
    name="gravity",
    instrument="gravimeter",
    quantity="gravity",
    unit="m/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: GravityReduction(scenario.gravimeter.lever_arm),
    largest_sigma=_LARGEST,
)
DISTURBANCE = MeasuredField(
    name="disturbance",
    instrument="gravimeter",
    quantity="disturbance",
    unit="m/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: DisturbanceReduction(scenario.gravimeter.lever_arm),
    largest_sigma=_LARGEST,
)
