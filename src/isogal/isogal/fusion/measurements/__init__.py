"""What the filter is updated with: a measurement model in each file.

With x the filter's error state, estimate minus truth (`isogal.inertial.error_state`, then the
auxiliary states), a measurement is

    z = h(state) + v,    h(state moved by dx) = h(state) + H dx,    v ~ N(0, R)

and is used where its normalised innovation squared is within the gate of its dimension
(docs/mathematics.md, section 3.13).

model            Measurement (the protocol), Innovation, and the update with rows z, h, H, R
position         a position, of an antenna or of the inertial sensors
ground_velocity  a velocity over ground in the navigation frame
satellites       what a satellite receiver gives, with the slow error of its positions
information      what a batch of readings says, in information form
height           a height sensor, with its errors as auxiliary states
velocity         a velocity aid, with its errors and the current or wind; standstill
fix              the measurements that a fix consists of
"""

from isogal.fusion.measurements.fix import LearntMapError, Widening, measurements_of
from isogal.fusion.measurements.ground_velocity import GroundVelocity
from isogal.fusion.measurements.height import HeightReading
from isogal.fusion.measurements.information import InformationUpdate
from isogal.fusion.measurements.model import Innovation, Measurement, Outcome
from isogal.fusion.measurements.position import PositionFix
from isogal.fusion.measurements.satellites import satellite_fix, satellite_velocity
from isogal.fusion.measurements.velocity import VelocityReading

__all__ = [
    "GroundVelocity",
    "HeightReading",
    "InformationUpdate",
    "Innovation",
    "LearntMapError",
    "Measurement",
    "Outcome",
    "PositionFix",
    "VelocityReading",
    "Widening",
    "measurements_of",
    "satellite_fix",
    "satellite_velocity",
]
