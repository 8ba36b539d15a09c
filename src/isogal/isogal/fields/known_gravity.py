"""What a navigator knows of horizontal gravity."""

from dataclasses import dataclass, field

from isogal.inertial.gravity import Compensation, no_compensation


@dataclass(frozen=True)
class KnownGravity:
    """A map to take off, and what is believed to be left."""

    compensation: Compensation = field(default_factory=no_compensation)
    residual_sigma: float = 0.0
    """m/s², of each component; 0 = nothing is left."""
    residual_length: float = 10_000.0
    """m, its correlation length along the track."""
