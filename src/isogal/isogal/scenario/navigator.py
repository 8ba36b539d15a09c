"""Sections about the navigator: what the INS on board gives it, the filter that fuses inertial
data with fixes, and what its solution promises of its own error."""

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


class Fusion(Section):
    """The navigator's filter."""

    filter: Literal["compiled", "reference"] = "compiled"
    """which unscented filter: Isogal's, or filterpy's to compare it with (slow)"""
    rate: Positive | None = Field(None, le=400.0)
    """steps of the navigator per second, Hz, of which imu.rate is a multiple: samples between are
    pre-integrated; null = imu.rate up to 10 Hz, the lowest possible from 1 Hz on for a faster
    IMU"""
    start: Literal["state", "align"] = "state"
    """what the navigator begins with: state = position, velocity and attitude, with the errors of
    initial_error; align = the position alone, or the satellites' (docs/nodes.md, Alignment)"""
    align_to: Positive | None = Field(None, le=0.5)
    """1-sigma of the heading at which it is aligned, rad; null = 1e-3, or what the gyroscopes can
    tell at rest, or 0.1 where they cannot find north"""
    false_rejection: float = Field(1e-9, ge=0.0, le=0.01)
    """innovation gate: how probable it is that a measurement which is as good as it says is not
    used; 0 = no gate"""
    lag: float = Field(0.0, ge=0.0, le=86400.0)
    """nav/smoothed: how much later the states of the past are said once more, as all data since
    have them, s; 0 = they are not"""


ERROR_TIME = 1000.0
"""s. Over a lag of 100 s the autocorrelation of the aided position error, in units of its claimed
covariance, falls as exp(-lag / T) with T of 900 to 1700 s in the told rows of docs/integrity.md
(740 s and more after the first hour); of the raw error 1/e is reached after 600 to 750 s."""


class Integrity(Section):
    """The horizontal protection level: docs/integrity.md."""

    risk: float = Field(1e-5, ge=1e-9, le=0.1)
    """how often the error may exceed the protection level, times per hour"""
    correlation_time: float = Field(ERROR_TIME, ge=10.0, le=3600.0)
    """of the position error, s: stretches above the level that are closer count once, and a
    shorter time gives a higher level"""
    alert_limit: Positive | None = None
    """protection level from which on the solution is of no use, m; null = none"""
