"""What a navigator assumes of inertial sensors: one bias and one white noise per axis that stand
for errors that have no state of their own (docs/mathematics.md, section 3.3).

A vehicle that is near level senses one g downwards, and turns with the Earth. There, what
misalignment and g-sensitivity add to a reading is constant, a bias: it takes the place of a
bias in the filter's initial covariance and in the bound. In a turn that bias changes; what this
costs is in docs/inertial-sensors.md."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.scenario import ImuErrors
from isogal.scenario.data_sheet import G

_WEIGHT = np.array([0.0, 0.0, G])
"""Specific force of a level vehicle at rest, body axes, m/s², without its sign."""


def bias_sigma(errors: ImuErrors) -> Array:
    """Return (6,) 1-sigma of the constant parts of the readings' errors, accelerometers (m/s²) and
    gyroscopes (rad/s): bias, and what scale factor, misalignment and g-sensitivity make of the
    weight and of the Earth's rate. The in-run bias is not among them: it has a state of its own
    (`isogal.fusion.imu_states`), as have the errors that show in turns."""
    force, rate = errors.accelerometer, errors.gyroscope
    squares = np.square([*force.bias, *rate.bias])
    squares[:3] += np.square(force.scale_factor) * np.square(_WEIGHT)
    squares[:3] += np.square(force.misalignment) * (G**2 - np.square(_WEIGHT))
    squares[3:] += np.square(rate.g_sensitivity) * G**2
    squares[3:] += (np.square(rate.misalignment) + np.square(rate.scale_factor)) * EARTH_RATE**2
    return np.sqrt(squares)


def noise_density(errors: ImuErrors, dt: float) -> Array:
    """Return (6,) densities of the white noise, m/s²/sqrt(Hz) and rad/s/sqrt(Hz).

    The gyroscopes' rounding of angles, of variance count² / 12 at each sample, turns the weight
    into the horizontal axes for an interval of dt (s): white noise of g count / sqrt(12) sqrt(dt)
    on the accelerometers. That of the accelerometers shifts the position by less than a count
    times the square root of the time, which is nothing."""
    count = math.hypot(*errors.gyroscope.quantisation[:2]) / math.sqrt(2.0)
    rounding = G * count * math.sqrt(dt / 12.0)
    density = np.array([*errors.accelerometer.random_walk, *errors.gyroscope.random_walk])
    if rounding > 0.0:
        density[:2] = np.hypot(density[:2], rounding)
    return density
