"""Map errors of the gravity gradient tensor's components that come from one wrong potential, drawn
at the places of a route (docs/mathematics.md, section 12.4)."""

from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.error_model import wave_factors
from isogal.scenario import Truth
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory

_WAVES = 2000
"""Plane waves that make a field. Its covariance is right on the mean over fields with any number;
with so many its distribution is Gaussian but for a part in a thousand of the kurtosis."""


def draw_potential_error(
    scenario: Truth, trajectory: Trajectory, index: Integers, runs: Sequence[int]
) -> Array:
    """Return (R, scans, C) how far the true components differ from their maps at the scans, 1/s².

    Each run's field is a sum of plane waves of random direction and phase, whose wavenumbers are
    drawn from the spectrum (randomisation method: Shinozuka 1971, J. Acoust. Soc. Am. 49:357), so
    that it is one field for all components on any route, without a grid that limits its
    wavelengths. The wavenumbers are stratified: each of N equal shares of the variance has one
    wave."""
    sigma, length = scenario.map_error.sigma, scenario.map_error.correlation_length
    components = scenario.gradiometer.components
    if sigma == 0.0:
        return np.zeros((len(runs), len(index), len(components)))
    places = _plane(trajectory, index)
    return np.stack([sigma * _field(scenario, run, places / length, components) for run in runs])


def _field(scenario: Truth, run: int, places: Array, components: Sequence[str]) -> Array:
    """Return (scans, C) one field of 1-sigma one at places (scans, 2) in units of its length."""
    random = generator(scenario.seed, run, "map_error_potential")
    share = (np.arange(_WAVES) + random.random(_WAVES)) / _WAVES
    # a share s of the variance has waves longer than k with 1 - 1 / sqrt(1 + k²) = s
    size = np.sqrt(np.maximum((1.0 - share) ** -2.0 - 1.0, 0.0))
    direction = 2.0 * np.pi * random.random(_WAVES)
    waves = size * np.stack([np.cos(direction), np.sin(direction)])
    amplitude = random.standard_normal((2, _WAVES)) / np.sqrt(_WAVES)
    factor = wave_factors(components, direction)
    phase = places @ waves
    # real part of factor (a - i b) exp(i k x)
    of_cosine = factor.real * amplitude[0] + factor.imag * amplitude[1]
    of_sine = factor.real * amplitude[1] - factor.imag * amplitude[0]
    return np.asarray(np.cos(phase) @ of_cosine.T + np.sin(phase) @ of_sine.T)


def _plane(trajectory: Trajectory, index: Integers) -> Array:
    """Return (scans, 2) m, north and east, the places of the scans in one plane."""
    latitude, longitude = trajectory.latitude[index], trajectory.longitude[index]
    north, east = metres_per_radian(float(latitude.mean()))
    away = np.remainder(longitude - longitude[0] + np.pi, 2.0 * np.pi) - np.pi
    return np.stack([(latitude - latitude[0]) * north, away * east], axis=-1)
