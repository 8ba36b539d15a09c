"""Section about the filter that fuses inertial data with fixes."""

from typing import Literal

from pydantic import Field

from isogal.scenario.section import Positive, Section


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
