"""Gravity and the gravity disturbance, measured by a gravimeter."""

from dataclasses import replace

from isogal.fields.measured import MeasuredField
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction

GRAVITY = MeasuredField(
    name="gravity",
    instrument="gravimeter",
    quantity="gravity",
    unit="m/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: GravityReduction(scenario.gravimeter.lever_arm),
    largest_sigma=1e-2,  # 1000 mGal, as much as the largest disturbances of the Earth
)
DISTURBANCE = replace(
    GRAVITY,
    name="disturbance",
    quantity="disturbance",
    reduction=lambda scenario: DisturbanceReduction(scenario.gravimeter.lever_arm),
)
