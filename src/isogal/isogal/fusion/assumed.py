"""What a filter assumes that agrees with what a scenario says of sensors and errors."""

import math

import numpy as np

from isogal.earth.ellipsoid import A
from isogal.fields.known_gravity import KnownGravity
from isogal.fusion import imu_states
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements.heading import heading_error_states
from isogal.fusion.measurements.height import (
    UNKNOWN_HEIGHT,
    height_error_states,
)
from isogal.fusion.measurements.position import position_error_states
from isogal.fusion.measurements.velocity import velocity_error_states
from isogal.fusion.model import FilterModel
from isogal.scenario import Assumed, PositionAid
from isogal.sensors.imu_model import bias_sigma, noise_density

# Floors of the initial 1-sigma, so that a scenario with a perfect start or perfect sensors still
# has a positive definite covariance.
_POSITION_FLOOR, _VELOCITY_FLOOR, _ATTITUDE_FLOOR = 1e-3, 1e-6, 1e-9
_BIAS_FLOOR = np.repeat((1e-10, 1e-14), 3)
"""Accelerometers (m/s²) and gyroscopes (rad/s)."""

UNKNOWN_GRAVITY = 1.6e-2
"""Vertical white noise density (m/s²/sqrt(Hz)) that stands for the gravity disturbance, which the
strapdown does not know: 36 mGal RMS over a correlation time of 1000 s, sqrt(2 sigma² tau). Without
it the vertical accelerometer, with the height known, would measure the east velocity through the
Eötvös term, to a precision that no vehicle has (docs/mathematics.md, section 3.7)."""

KNOWN_HEIGHT = 0.1
"""m, 1-sigma of a height that the scenario gives."""

UNSURE, SOON = 0.1, 3600.0
"""rad, and s: a heading that may be wrong by so much after so long is not known to where sines are
linear in it. Sigma points as far out as that would make a turn of the velocity shorter than it is,
and each change of speed a measurement of the heading (docs/mathematics.md, section 3.17); close to
the centre they are the derivative."""
ADRIFT = 2e3
"""m that biases may add to the position in that time before a matcher has to follow them: over as
much what a map shows changes."""
CLOSE = 0.1
"""Spread of the sigma points there, of that of the others."""


def filter_model(assumed: Assumed, gravity: KnownGravity | None = None) -> FilterModel:
    """Return the model that agrees with a scenario.

    Parameters
    ----------
    assumed : Assumed
    gravity : KnownGravity, optional
        What the navigator knows of horizontal gravity; default: that there is none beside normal
        gravity.
    """
    gravity = gravity or KnownGravity()
    sensors, initial, height = assumed.imu.sensors, assumed.initial_error, assumed.height
    noise = noise_density(sensors, 1.0 / assumed.imu.rate).tolist()
    position = max(initial.position, _POSITION_FLOOR)
    velocity = max(initial.velocity, _VELOCITY_FLOOR)
    tilt, heading = max(initial.tilt, _ATTITUDE_FLOOR), max(initial.heading, _ATTITUDE_FLOOR)
    up = UNKNOWN_HEIGHT if height.measured else KNOWN_HEIGHT
    sigma = (position, position, up, velocity, velocity, 0.01, tilt, tilt, heading)
    possible = (
        *_gravity_states(gravity),
        *imu_states.states(sensors),
        *(one for aid in (height, *(assumed.heights or ())) for one in height_error_states(aid)),
        *velocity_error_states(assumed.velocity_aids),
        *(
            one
            for aid in assumed.aids
            if isinstance(aid, PositionAid)
            for one in position_error_states(aid, height.measured)
        ),
        *(one for aid in assumed.headings or () for one in heading_error_states(aid)),
    )
    auxiliary = tuple(one for one in possible if one.sigma > 0.0)
    turn = noise[5] * math.sqrt(SOON) + sensors.gyroscope.bias[2] * SOON
    unsure = math.hypot(heading, turn) > UNSURE
    biases = np.maximum(bias_sigma(sensors), _BIAS_FLOOR)
    adrift = _drift(*biases.reshape(2, 3)[:, :2].max(axis=1)) > ADRIFT
    return FilterModel(
        noise=(*noise[:2], math.hypot(noise[2], UNKNOWN_GRAVITY), *noise[3:]),
        initial_sigma=(*sigma, *biases.tolist()),
        dt=1.0 / assumed.navigation_rate,
        filter=assumed.fusion.filter,
        height_sigma=height.sigma if height.measured else KNOWN_HEIGHT,
        height_measured=height.measured,
        alpha=CLOSE if unsure else 1.0,
        unsure_heading=unsure,
        slow_errors=unsure or bool(assumed.velocity_aids) or assumed.gnss.doubted or adrift,
        auxiliary=auxiliary,
        gravity=gravity,
        preintegrated=assumed.samples_per_step > 1,
        false_rejection=assumed.fusion.false_rejection,
        judges_satellites=assumed.gnss.judged,
    )


def _drift(accelerometer: float, gyroscope: float) -> float:
    """Return how far biases (m/s² and rad/s, 1-sigma) of horizontal axes take a navigator in
    `SOON`, m (Titterton & Weston 2004, section 12.3)."""
    schuler = math.sqrt(9.8 / A)
    by_force = (1.0 - math.cos(schuler * SOON)) * accelerometer / schuler**2
    by_rate = (SOON - math.sin(schuler * SOON) / schuler) * gyroscope * A
    return math.hypot(by_force, by_rate)


def _gravity_states(gravity: KnownGravity) -> tuple[AuxiliaryState, ...]:
    """Return the residual to north and to east, first-order Gauss-Markov processes along the track
    (Jekeli 2001, section 6.6; docs/mathematics.md, section 3.9).

    Their 1-sigma and length hold until the matcher has learnt how wrong the map is
    (`isogal.fusion.state.FilterState.residual_gravity`)."""
    sigma, length = gravity.residual_sigma, gravity.residual_length
    return tuple(
        AuxiliaryState(name, "gravity", axis, sigma, length=length)
        for axis, name in enumerate(("gravity_north", "gravity_east"))
    )
