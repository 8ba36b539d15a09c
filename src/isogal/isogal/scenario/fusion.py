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
    false_rejection: float = Field(1e-9, ge=0.0, le=0.01)
    """innovation gate: how probable it is that a measurement which is as good as it says is not
    used; 0 = no gate"""
    lag: float = Field(0.0, ge=0.0, le=86400.0)
    """nav/smoothed: how much later the states of the past are said once more, as all data since
    have them, s; 0 = they are not"""
