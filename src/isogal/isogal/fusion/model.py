"""What the filter assumes about sensors and aids."""

import math
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np
from scipy.special import chdtri

from isogal.arrays import Array
from isogal.fields.known_gravity import KnownGravity
from isogal.fusion.auxiliary import AuxiliaryState, auxiliary_of
from isogal.fusion.sigma_points import merwe_weights
from isogal.fusion.ukf import Assumptions
from isogal.inertial.error_state import BATCH, FILTER_NAMES, FILTER_STATES
from isogal.inertial.strapdown import MEANS, ROTATIONS

SLOW = (
    *((f"accelerometer_{axis}", f"accelerometer_in_run_{axis}") for axis in "xy"),
    *((f"gyroscope_{axis}", f"gyroscope_in_run_{axis}") for axis in "xyz"),
    ("gyroscope_scale_zz",),
    ("velocity_scale",),
    ("velocity_yaw",),
)
"""Sums of states that tilt the navigator, turn its heading or stretch its path: biases of the
horizontal accelerometers (m/s²) and the gyroscopes (rad/s), the vertical gyroscope's scale factor,
the velocity aid's scale factor and its yaw (rad)."""


@cache
def quantile(probability: float, dimensions: int) -> float:
    """Return what chi-square of so many dimensions exceeds with a probability; infinity for 0."""
    return float(chdtri(dimensions, probability)) if probability > 0.0 else math.inf


@dataclass(frozen=True, slots=True)
class FilterModel:
    """What the filter assumes about sensors and aids."""

    noise: tuple[float, ...]
    """White noise densities of accelerometers (3; m/s²/sqrt(Hz)) and gyroscopes (3;
    rad/s/sqrt(Hz))."""
    initial_sigma: tuple[float, ...]
    """(15,) 1-sigma of the error state at the start."""
    dt: float
    """IMU interval, s."""
    height_sigma: float = 0.1
    """1-sigma of a height that comes with the inertial data, known or measured, m; 0 = none."""
    alpha: float = 1.0
    """How far the sigma points are spread."""
    filter: Literal["compiled", "reference"] = "compiled"
    """Who filters: `isogal.fusion.ukf` or `isogal.fusion.reference`."""
    auxiliary: tuple[AuxiliaryState, ...] = ()
    """The states beside the fifteen, in their order."""
    gravity: KnownGravity = field(default_factory=KnownGravity, repr=False, compare=False)
    """What is known of horizontal gravity: what the strapdown takes off and what is left."""
    preintegrated: bool = False
    """Whether inertial data are pre-integrated samples rather than means over an interval."""
    false_rejection: float = 1e-9
    """How probable it is that the innovation gate does not use a measurement that is as good as it
    says; 0 = no gate."""
    height_measured: bool = False
    """Whether such a height is a sensor's; one that is known passes no gate."""
    unsure_heading: bool = False
    """Whether the heading may be wrong by more than what sines are linear in."""
    slow_errors: bool = False
    """Whether matchers follow slow errors of the sensors, too (`Passage`): where the vehicle goes
    where the heading points, so that a gyroscope's bias decides; where satellites that may be
    wrong have told biases by what they make of the tilt; where biases lead away by kilometres."""
    judges_satellites: bool = True
    """Whether inertial data may show that satellites are wrong."""
    places: dict[str, int] = field(init=False, repr=False, compare=False)
    """Where each auxiliary state stands among all, by its name."""
    assumptions: Assumptions = field(init=False, repr=False, compare=False)
    """The same as the compiled filter takes it."""

    def __post_init__(self) -> None:
        assumptions = Assumptions(
            self.dt,
            np.array(self.noise),
            self.height_sigma,
            *self.height_contents(),
            self.gate(1) if self.height_measured else math.inf,
            merwe_weights(self.alpha, self.states),
            self.alpha,
            auxiliary_of(self.auxiliary),
            self.gravity.compensation,
            ROTATIONS if self.preintegrated else MEANS,
        )
        names = [one.name for one in self.auxiliary]
        object.__setattr__(
            self, "places", {name: k for k, name in enumerate(names, FILTER_STATES)}
        )
        object.__setattr__(self, "assumptions", assumptions)

    def height_contents(self, prefix: str = "height") -> tuple[Array, Array]:
        """Return what a reading of a height sensor contains of each auxiliary state: (M,) as it
        is, and (M,) per m of the height. `prefix` is of the names of the sensor's states."""
        names = [one.name for one in self.auxiliary]
        constant = [float(name in (f"{prefix}_bias", f"{prefix}_weather")) for name in names]
        return np.array(constant), np.array([float(name == f"{prefix}_scale") for name in names])

    def passage_rows(self) -> Array:
        """Return (n, N) the states of a `Passage` per unit of the filter's."""
        places = {name: k for k, name in enumerate(FILTER_NAMES)} | self.places
        rows = [np.eye(self.states)[k] for k in BATCH]
        for names in SLOW if self.slow_errors else ():
            row = np.zeros(self.states)
            row[[places[name] for name in names if name in places]] = 1.0
            rows.append(row)
        return np.array([row for row in rows if row.any()])

    def gate(self, dimensions: int) -> float:
        """Return the largest normalised innovation squared of so many dimensions that is used: a
        measurement that cannot be right changes nothing (docs/mathematics.md, section 3.13)."""
        return quantile(self.false_rejection, dimensions)

    @property
    def states(self) -> int:
        """Number of states, the auxiliary ones included."""
        return FILTER_STATES + len(self.auxiliary)
