"""What the filter is updated with: a measurement model in each file.

With x the filter's error state, estimate minus truth (`isogal.inertial.error_state`, then the
auxiliary states), a measurement is

    z = h(state) + v,    h(state moved by dx) = h(state) + H dx,    v ~ N(0, R)

and is used where its normalised innovation squared is within the gate of its dimension
(docs/mathematics.md, section 3.13).

model            Measurement (the protocol), Innovation, and the update with rows z, h, H, R
position         a position, of an antenna or of the inertial sensors, with its slow error
ground_velocity  a velocity over ground in the navigation frame, as a satellite receiver's
aids             readings of any aid of a scenario as measurements
heading          a heading, with its mounting and slow errors as auxiliary states
information      what a batch of readings says, in information form
height           a height sensor, with its errors as auxiliary states
velocity         a velocity aid, with its errors and the current or wind; standstill
rest             means of the inertial data of a vehicle at rest
sample_noise     what an inertial sample says of its own noise
map_reading      a reading of a map by itself, linear about a place
fix              the measurements that a fix consists of
trust            how an aid that was beyond the gate, or contradicted, is used again
"""

from isogal.fusion.measurements.aids import reading_of
from isogal.fusion.measurements.fix import OF_FIXES, LearntMapError, Widening, measurements_of
from isogal.fusion.measurements.ground_velocity import GroundVelocity, satellite_velocity
from isogal.fusion.measurements.heading import HeadingReading
from isogal.fusion.measurements.height import HeightReading
from isogal.fusion.measurements.information import InformationUpdate
from isogal.fusion.measurements.model import Innovation, Measurement, Outcome
from isogal.fusion.measurements.position import PositionFix, position_fix
from isogal.fusion.measurements.rest import AtRest
from isogal.fusion.measurements.sample_noise import SampleNoise
from isogal.fusion.measurements.velocity import VelocityReading

__all__ = [
    "OF_FIXES",
    "AtRest",
    "GroundVelocity",
    "HeadingReading",
    "HeightReading",
    "InformationUpdate",
    "Innovation",
    "LearntMapError",
    "Measurement",
    "Outcome",
    "PositionFix",
    "SampleNoise",
    "VelocityReading",
    "Widening",
    "measurements_of",
    "position_fix",
    "reading_of",
    "satellite_velocity",
]
