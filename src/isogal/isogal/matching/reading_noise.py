"""What a batch's readings have beside white noise, as specified: states with columns, and the
covariance that follows from them (docs/mathematics.md, section 5.2)."""

import math
from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array
from isogal.matching.parameters import Parameters
from isogal.scenario import Gravimeter, Height
from isogal.sensors.gravimeter_errors import accelerations
from isogal.sensors.platform import mean_error
from isogal.sensors.reduction import Reduction, State

INSTANT_S = 1e-3
"""Correlation time of what only the readings of one scan have in common."""
CERTAIN = 3.0
"""1-sigmas of its errors by which a measured height changes, or departs from a line, at least
where it is the vehicle that does."""
_State = tuple[str, float, float, Array]
"""Name, 1-sigma, correlation time (s), and what it adds to each of T readings per unit."""


def noise_states(
    instrument: Gravimeter, time: Array, velocity: Array, force: Array | None = None
) -> list[_State]:
    """Return what is correlated in time, what the vehicle's accelerations and its speed add, and
    what a platform that is not level does (docs/mathematics.md, section 2.8).

    The walk of the bias is not among them, which is the matcher's, nor is the mean of the
    platform's error (`platform.mean_error`).

    Parameters
    ----------
    time : (T,) array
        s.
    velocity : (T, 2) array
        m/s, north and east, at the stamps.
    force : (T, 2) array, optional
        m/s², horizontal specific force of each; default: as the velocities change.
    """
    one, several = np.ones(len(time)), len(time) > 1
    found: list[_State] = []
    if instrument.correlated_sigma > 0.0:
        time_constant = instrument.correlation_time
        found.append(("correlated", instrument.correlated_sigma, time_constant, one))
    if instrument.cross_coupling > 0.0:
        forward, right = accelerations(time, velocity).T if several else np.zeros((2, len(time)))
        share = instrument.cross_coupling
        found.append(("coupling_forward", share, np.inf, forward))
        found.append(("coupling_right", share, np.inf, right))
    if instrument.dynamic_pressure > 0.0:
        square: Array = (velocity**2).sum(axis=1)
        found.append(("dynamic_pressure", instrument.dynamic_pressure, np.inf, square))
    if instrument.platform_tilt > 0.0:
        if force is None:
            force = np.gradient(velocity, time, axis=0) if several else 0.0 * velocity
        north, east = force[:, 0], force[:, 1]
        tilt, time_constant = instrument.platform_tilt, instrument.platform_time
        found.append(("levelling", -mean_error(instrument), 0.5 * time_constant, one))
        found.append(("tilt_north", tilt, time_constant, east))
        found.append(("tilt_east", tilt, time_constant, -north))
    return found


def height_states(
    settings: Height, reduction: Reduction, at: State, level: Array | float = 0.0
) -> list[_State]:
    """Return what an error of the measured height makes of reduced readings (docs/mathematics.md,
    sections 3.11 and 5.2); nothing where their reduction does not depend on the height.

    Parameters
    ----------
    at : State
        Of T readings, as measured and estimated.
    level : (T,) array or float
        Heights at which the vehicle surely was last, m (`surely_at`).
    """
    slope = reduction.height_slope(at)
    if not slope.any():
        return []
    each = [
        ("height_bias", settings.bias, np.inf, slope),
        ("height_scale", settings.scale, np.inf, slope * np.asarray(at.height)),
        ("height_weather", settings.weather_sigma, settings.weather_time, slope),
        # which share of what the height departs from that level by is not the vehicle's
        ("height_change", 1.0, np.inf, slope * (np.asarray(at.height) - level)),
    ]
    return [one for one in each if one[1] > 0.0]


def surely_at(settings: Height, before: float, height: float) -> float:
    """Return the height (m) that a vehicle has surely gone to by one that is measured: as `before`
    unless that is further away than the height's errors."""
    reach = CERTAIN * math.hypot(settings.sigma, settings.bias, settings.weather_sigma)
    return min(max(before, height - reach), height + reach)


def of_vehicle(settings: Height, time: Array, height: Array) -> Array:
    """Return (T,) how a vehicle has gone up and down by measured heights (T,), m, at times (T,),
    s: their straight line, and what departs from that by more than their errors do
    (docs/mathematics.md, section 5.4)."""
    if not settings.measured or len(time) < 3:
        return height
    line = np.polynomial.Polynomial.fit(time, height, 1)(time)
    rest = height - line
    # a random walk for so long has this variance about its line
    walk = 2.0 * settings.weather_sigma**2 / settings.weather_time * (time[-1] - time[0]) / 15.0
    errors = CERTAIN**2 * (settings.sigma**2 + walk)
    share = 1.0 - errors / max(float((rest**2).mean()), errors)
    return np.asarray(line + share * rest)


def joined(states: Sequence[_State]) -> Parameters | None:
    """Return states together; None where there are none."""
    if not states:
        return None
    names, sigma, time, columns = zip(*states, strict=True)
    return Parameters(
        names, np.array(sigma), np.stack(columns, axis=1), time=np.array(time, dtype=np.float64)
    )


def scan_noise(covariance: Array, scans: int) -> tuple[Array, Parameters | None]:
    """Return (T C,) the 1-sigma of the white part of T scans of C readings each, of covariance
    (C, C), and what the readings of a scan have in common; None where that is nothing.

    In units of the readings' own 1-sigmas the least eigenvalue is white, and the rest are C - 1
    unknowns that are new at each scan."""
    channels = len(covariance)
    sigma = np.sqrt(np.diag(covariance))
    unit = covariance / np.outer(sigma, sigma)
    if np.abs(unit - np.eye(channels)).max() < 1e-9:
        return np.tile(sigma, scans), None
    values, vectors = np.linalg.eigh(unit)
    columns = sigma[:, None] * vectors * np.sqrt(values - values[0])
    common = Parameters(
        ("",) * (channels - 1),  # nobody wants to see them
        np.ones(channels - 1),
        np.tile(columns[:, 1:], (scans, 1)),
        time=np.full(channels - 1, INSTANT_S),
    )
    return np.tile(sigma * np.sqrt(values[0]), scans), common
