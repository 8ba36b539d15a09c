"""Auxiliary states of a velocity aid's errors and of the water or air that it moves through
(docs/mathematics.md, section 3.12)."""

from isogal.fusion.auxiliary import AuxiliaryState
from isogal.scenario import Velocity

SCALE = "velocity_scale"
PITCH, YAW = "velocity_pitch", "velocity_yaw"
NORTH, EAST = "current_north", "current_east"


def states(velocity: Velocity) -> tuple[AuxiliaryState, ...]:
    """Return scale factor error, mounting errors about the right and the down axis, and the
    current or wind to the north and east, those that are not zero."""
    if velocity.kind == "none":
        return ()
    scale, misalignment, current = (
        velocity.number(key) for key in ("scale", "misalignment", "current_sigma")
    )
    time, length = velocity.current_time, velocity.current_length
    every = (
        AuxiliaryState(SCALE, "none", 0, scale),
        AuxiliaryState(PITCH, "none", 1, misalignment),
        AuxiliaryState(YAW, "none", 2, misalignment),
        AuxiliaryState(NORTH, "none", 0, current, time=time, length=length),
        AuxiliaryState(EAST, "none", 1, current, time=time, length=length),
    )
    return tuple(state for state in every if state.sigma > 0.0)
