"""Section about the INS on board: what it gives to the navigator."""

from typing import Literal

from pydantic import Field

from isogal.scenario.section import NonNegative, Positive, Section


class Ins(Section):
    """What is there of the inertial navigator: its sensors, or only its solution."""

    source: Literal["imu", "solution"] = "imu"
    """imu: samples of its inertial sensors; solution: position, velocity and attitude of an INS,
    whose sensors and start the sections imu and initial_error then describe"""
    attitude: bool = True
    """whether its solution has an attitude; without, that of a level vehicle on its course stands
    for it"""
    jump: Positive = 5.0
    """m by which its position may miss what its velocity says of a second; beyond it the INS has
    set itself anew"""
    position_resolution: NonNegative = Field(0.0, le=100.0)
    """last digit of its position, m; 0 = none: as many digits as a number has"""
    velocity_resolution: NonNegative = Field(0.0, le=1.0)
    """last digit of its velocity, m/s"""
    angle_resolution: NonNegative = Field(0.0, le=0.1)
    """last digit of roll, pitch and heading, rad"""

    @property
    def gives_solution(self) -> bool:
        """Whether there is only its solution."""
        return self.source == "solution"
