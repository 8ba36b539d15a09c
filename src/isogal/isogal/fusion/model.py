"""What the filter assumes about sensors and aids."""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from isogal.fields.known_gravity import KnownGravity
from isogal.fusion import gravity_states, height_states, imu_states, velocity_states
from isogal.fusion.auxiliary import AuxiliaryState, auxiliary_of
from isogal.fusion.gate import quantile
from isogal.fusion.height_states import HeightReading
from isogal.fusion.sigma_points import merwe_weights
from isogal.fusion.ukf import Assumptions
from isogal.inertial.error_state import BATCH, FILTER_STATES
from isogal.inertial.strapdown import MEANS, ROTATIONS
from isogal.scenario import Scenario
from isogal.sensors.imu_model import bias_sigma, noise_density

# Floors of the initial 1-sigma, so that a scenario with a perfect start still has a positive
# definite covariance.
_POSITION_FLOOR, _VELOCITY_FLOOR, _ATTITUDE_FLOOR = 1e-3, 1e-6, 1e-9

UNKNOWN_GRAVITY = 1.6e-2
"""Vertical white noise density (m/s²/sqrt(Hz)) that stands for the gravity disturbance, which the
strapdown does not know: 36 mGal RMS over a correlation time of 1000 s, sqrt(2 sigma² tau). Without
it the vertical accelerometer, with the height known, would measure the east velocity through the
Eötvös term, to a precision that no vehicle has (docs/mathematics.md, section 3.7)."""


@dataclass(frozen=True, slots=True)
class FilterModel:
    """What the filter assumes about sensors and aids; the same for all runs."""

    noise: tuple[float, ...]
    """White noise densities of accelerometers (3; m/s²/sqrt(Hz)) and gyroscopes (3;
    rad/s/sqrt(Hz))."""
    initial_sigma: tuple[float, ...]
    """(15,) 1-sigma of the error state at the start."""
    dt: float
    """IMU interval, s."""
    height_sigma: float = 0.1
    """1-sigma of the known height, m; 0 = no height aid."""
    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0
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
    """Whether the height is a sensor's; one that is known passes no gate."""
    gates: tuple[float, ...] = field(init=False, repr=False, compare=False)
    """The largest normalised innovation squared of 1, 2, ... 7 dimensions that is used."""
    assumptions: Assumptions = field(init=False, repr=False, compare=False)
    """The same as the compiled filter takes it."""

    def __post_init__(self) -> None:
        scaling = self.alpha, self.beta, self.kappa
        gates = tuple(quantile(self.false_rejection, 1 + k) for k in range(len(BATCH)))
        assumptions = Assumptions(
            self.dt,
            np.array(self.noise),
            self.height_sigma,
            merwe_weights(*scaling, self.states),
            scaling,
            auxiliary_of(self.auxiliary),
            self.gravity.compensation,
            self.height_reading,
            ROTATIONS if self.preintegrated else MEANS,
            gates[0] if self.height_measured else math.inf,
            gates[1],
        )
        object.__setattr__(self, "gates", gates)
        object.__setattr__(self, "assumptions", assumptions)

    @property
    def height_reading(self) -> HeightReading:
        """What a reading of the height contains of the auxiliary states."""
        return height_states.reading_of(self.auxiliary)

    def gate(self, dimensions: int) -> float:
        """Return the largest normalised innovation squared of so many dimensions that is used."""
        return self.gates[dimensions - 1]

    @property
    def states(self) -> int:
        """Number of states, the auxiliary ones included."""
        return FILTER_STATES + len(self.auxiliary)

    @classmethod
    def from_scenario(
        cls, scenario: Scenario, gravity: KnownGravity | None = None
    ) -> "FilterModel":
        """Return the model that agrees with what a scenario says of sensors and errors.

        Parameters
        ----------
        scenario : Scenario
        gravity : KnownGravity, optional
            What the navigator knows of horizontal gravity; default: that there is none beside
            normal gravity.
        """
        gravity = gravity or KnownGravity()
        sensors, initial = scenario.imu.sensors, scenario.initial_error
        noise = noise_density(sensors, 1.0 / scenario.imu.rate).tolist()
        position, velocity = (
            max(initial.position, _POSITION_FLOOR),
            max(initial.velocity, _VELOCITY_FLOOR),
        )
        tilt, heading = max(initial.tilt, _ATTITUDE_FLOOR), max(initial.heading, _ATTITUDE_FLOOR)
        height, known = scenario.height, 0.1
        start = height_states.UNKNOWN_HEIGHT if height.measured else known
        sigma = (position, position, start, velocity, velocity, 0.01, tilt, tilt, heading)
        return cls(
            noise=(
                *noise[:2],
                math.hypot(noise[2], UNKNOWN_GRAVITY),
                *noise[3:],
            ),
            initial_sigma=(*sigma, *bias_sigma(sensors).tolist()),
            dt=1.0 / scenario.navigation_rate,
            filter=scenario.fusion.filter,
            height_sigma=height.sigma if height.measured else known,
            auxiliary=(
                *gravity_states.states(gravity),
                *imu_states.states(scenario),
                *height_states.states(height),
                *velocity_states.states(scenario.velocity),
            ),
            gravity=gravity,
            preintegrated=scenario.samples_per_step > 1,
            false_rejection=scenario.fusion.false_rejection,
            height_measured=height.measured,
        )
