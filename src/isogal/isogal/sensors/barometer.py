"""Height from pressure: a barometer in air, a depth sensor in water (docs/mathematics.md, section
3.11)."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.scenario import Height, Truth
from isogal.seeds import generator
from isogal.sensors.gravimeter_errors import gauss_markov
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
_LAYERS = (  # geopotential height of the base, m; temperature there, K; its change, K/m
    (0.0, 288.15, -0.0065),
    (11_000.0, 216.65, 0.0),
    (20_000.0, 216.65, 0.001),
    (32_000.0, 228.65, 0.0028),
    (47_000.0, 270.65, 0.0),
)


def _ratio(height: float, base: float, temperature: float, lapse: float) -> float:
    """Return pressure at a geopotential height over that at its layer's base."""
    if lapse == 0.0:
        return math.exp(-GRAVITY * (height - base) / (_GAS * temperature))
    return (1.0 + lapse * (height - base) / temperature) ** (-GRAVITY / (_GAS * lapse))


def _base_ratios() -> tuple[float, ...]:
    """Return the pressure at each layer's base over that at height 0."""
    ratios = [1.0]
    for layer, above in itertools.pairwise(_LAYERS):
        ratios.append(ratios[-1] * _ratio(above[0], *layer))
    return tuple(ratios)


_BASES = _base_ratios()


def standard_pressure(height: ArrayLike, reference: float = STANDARD_PRESSURE) -> Array:
    """Return the pressure (Pa) of the standard atmosphere at geometric heights (m, -5 to 50 km),
    whose pressure at height 0 is `reference`."""
    h = np.asarray(height, dtype=float)
    geopotential = _EARTH_RADIUS * h / (_EARTH_RADIUS + h)
    ratio = np.empty(geopotential.shape)
    for k, layer in enumerate(_LAYERS):
        inside = geopotential >= layer[0] if k else np.ones(h.shape, dtype=np.bool_)
        ratio = np.where(inside, _BASES[k] * _ratios(geopotential, *layer), ratio)
    return np.asarray(reference * ratio)


def _ratios(height: Array, base: float, temperature: float, lapse: float) -> Array:
    """Do what `_ratio` does, for arrays."""
    if lapse == 0.0:
        return np.exp(-GRAVITY * (height - base) / (_GAS * temperature))
    warmth = np.maximum(1.0 + lapse * (height - base) / temperature, 1e-3)
    return np.asarray(warmth ** (-GRAVITY / (_GAS * lapse)))


def standard_height(pressure: ArrayLike, reference: float = STANDARD_PRESSURE) -> Array:
    """Return the geometric height (m) at which the standard atmosphere has a pressure (Pa), the
    inverse of `standard_pressure`."""
    ratio = np.asarray(pressure, dtype=float) / reference
    geopotential = np.empty(ratio.shape)
    for k, (base, temperature, lapse) in enumerate(_LAYERS):
        inside = ratio <= _BASES[k] if k else np.ones(ratio.shape, dtype=np.bool_)
        share = ratio / _BASES[k]
        if lapse == 0.0:
            above = -_GAS * temperature / GRAVITY * np.log(share)
        else:
            above = temperature / lapse * (share ** (-_GAS * lapse / GRAVITY) - 1.0)
        geopotential = np.where(inside, base + above, geopotential)
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


def simulate_heights(truth: Truth, trajectory: Trajectory, runs: Sequence[int]) -> Array:
    """Return (R, K) the heights (m) that the sensor of each run reads at the end of each IMU
    interval, NaN where it reads none."""
    settings = truth.height
    step = truth.steps_per_height
    index = np.arange(step, len(trajectory) + 1, step)
    time, true = trajectory.time[index], trajectory.height[index]
    result = np.full((len(runs), len(trajectory)), np.nan)
    for row, run in zip(result, runs, strict=True):
        bias, scale = generator(truth.seed, run, "height_bias").standard_normal(2)
        white = generator(truth.seed, run, "height_noise").standard_normal(len(index))
        normal = generator(truth.seed, run, "height_weather").standard_normal(len(index))
        weather = gauss_markov(settings.weather_sigma, settings.weather_time, time, normal)
        row[index - 1] = (
            true * (1.0 + settings.scale * scale)
            + settings.bias * bias
            + weather
            + settings.sigma * white
        )
    return result
