"""Section about what a navigation solution promises of its own error."""

from pydantic import Field

from isogal.scenario.section import Positive, Section

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
