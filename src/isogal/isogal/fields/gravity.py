"""Gravity and the gravity disturbance, measured by a gravimeter."""

from isogal.fields.measured import MeasuredField
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction

GRAVITY = MeasuredField(
    name="gravity",
    instrument="gravimeter",
    quantity="gravity",
    unit="m/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: GravityReduction(),
)
DISTURBANCE = MeasuredField(
    name="disturbance",
    instrument="gravimeter",
    quantity="disturbance",
    unit="m/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: DisturbanceReduction(),
)
