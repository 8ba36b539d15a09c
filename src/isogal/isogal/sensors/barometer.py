"""Height from pressure: a barometer in air, a depth sensor in water (docs/mathematics.md, section
3.11)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array, Integers
from isogal.scenario import Height
from isogal.seeds import generator
from isogal.sensors.noise import gauss_markov
from isogal.sensors.position_aid import AidReadings, aid_index
from isogal.sensors.trajectory import Trajectory

# US Standard Atmosphere, 1976 (NOAA-S/T 76-1562), equations 18, 19, 33a, 33b and table 4
GRAVITY = 9.80665
"""m/s², standard gravity."""
_GAS = 8.31432 / 0.0289644
"""J/(kg K), of dry air, as the standard has it."""
_EARTH_RADIUS = 6_356_766.0
"""m, by which the standard turns geometric into geopotential height."""
STANDARD_PRESSURE = 101_325.0
"""Pa."""
_BASE, _TEMPERATURE, _LAPSE = np.transpose(
    [
        (0.0, 288.15, -0.0065),
        (11_000.0, 216.65, 0.0),
        (20_000.0, 216.65, 0.001),
        (32_000.0, 228.65, 0.0028),
        (47_000.0, 270.65, 0.0),
    ]
)
"""Of each layer: geopotential height of the base, m; temperature there, K; its change, K/m."""
_EXPONENT = -GRAVITY / (_GAS * np.where(_LAPSE == 0.0, 1.0, _LAPSE))
"""Of the temperature's ratio, to which the pressure is proportional where that changes."""


def _ratio(height: Array, k: Integers) -> Array:
    """Return the pressure at geopotential heights over that at the base of their layers k."""
    above, temperature = height - _BASE[k], _TEMPERATURE[k]
    warmth = np.maximum(1.0 + _LAPSE[k] * above / temperature, 1e-3)
    isothermal = np.exp(-GRAVITY * above / (_GAS * temperature))
    return np.where(_LAPSE[k] == 0.0, isothermal, warmth ** _EXPONENT[k])


_AT_BASE = np.cumprod([1.0, *_ratio(_BASE[1:], np.arange(len(_BASE) - 1))])
"""Pressure at each layer's base over that at height 0."""


def standard_pressure(height: ArrayLike, reference: float = STANDARD_PRESSURE) -> Array:
    """Return the pressure (Pa) of the standard atmosphere at geometric heights (m, -5 to 50 km),
    whose pressure at height 0 is `reference`."""
    h = np.asarray(height, dtype=float)
    geopotential = _EARTH_RADIUS * h / (_EARTH_RADIUS + h)
    k = np.maximum(np.searchsorted(_BASE, geopotential, side="right") - 1, 0)
    return np.asarray(reference * _AT_BASE[k] * _ratio(geopotential, k))


def standard_height(pressure: ArrayLike, reference: float = STANDARD_PRESSURE) -> Array:
    """Return the geometric height (m) at which the standard atmosphere has a pressure (Pa), the
    inverse of `standard_pressure`."""
    ratio = np.asarray(pressure, dtype=float) / reference
    k = np.maximum(np.searchsorted(-_AT_BASE, -ratio, side="right") - 1, 0)
    share, temperature, lapse = ratio / _AT_BASE[k], _TEMPERATURE[k], _LAPSE[k]
    isothermal = -_GAS * temperature / GRAVITY * np.log(share)
    warmer = temperature * (share ** (1.0 / _EXPONENT[k]) - 1.0)
    above = np.where(lapse == 0.0, isothermal, warmer / np.where(lapse == 0.0, 1.0, lapse))
    geopotential = _BASE[k] + above
    return np.asarray(_EARTH_RADIUS * geopotential / (_EARTH_RADIUS - geopotential))


def pressure_of(height: ArrayLike, settings: Height) -> Array:
    """Return the pressure (Pa) that a sensor of a scenario takes for a height (m)."""
    if settings.source == "depth":
        weight = settings.water_density * GRAVITY
        return settings.reference_pressure - weight * np.asarray(height, dtype=float)
    return standard_pressure(height, settings.reference_pressure)


def height_of(pressure: ArrayLike, settings: Height) -> Array:
    """Return the height (m) of a pressure (Pa), the inverse of `pressure_of`."""
    if settings.source == "depth":
        weight = settings.water_density * GRAVITY
        return (settings.reference_pressure - np.asarray(pressure, dtype=float)) / weight
    return standard_height(pressure, settings.reference_pressure)


def height_slope(pressure: float, settings: Height) -> float:
    """Return d(height)/d(pressure), m/Pa, at a pressure (Pa)."""
    step = 1e-4 * abs(pressure)
    high, low = height_of(np.array([pressure + step, pressure - step]), settings)
    return float(high - low) / (2.0 * step)


def simulate_heights(
    settings: Height, trajectory: Trajectory, seed: int, runs: Sequence[int]
) -> AidReadings:
    """Return the heights (R, M), m, that a sensor as it really is reads in each run."""
    prefix = settings.prefix
    index = aid_index(settings.interval, trajectory)
    time, true = trajectory.time[index], trajectory.height[index]
    keep = np.exp(-np.diff(time) / settings.weather_time)
    result = np.empty((len(runs), len(index)))
    for row, run in zip(result, runs, strict=True):
        bias, scale = generator(seed, run, f"{prefix}_bias").standard_normal(2)
        white = generator(seed, run, f"{prefix}_noise").standard_normal(len(index))
        normal = generator(seed, run, f"{prefix}_weather").standard_normal(len(index))
        weather = settings.weather_sigma * gauss_markov(keep, normal)
        row[:] = (
            true * (1.0 + settings.scale * scale)
            + settings.bias * bias
            + weather
            + settings.sigma * white
        )
    return AidReadings(index, result)
