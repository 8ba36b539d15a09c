"""Covariance of the noise of a batch's readings, as told (docs/mathematics.md, section 5.2)."""

import numpy as np

from isogal.arrays import Array
from isogal.scenario import Gravimeter, Height
from isogal.sensors.gravimeter_errors import accelerations
from isogal.sensors.platform import mean_error
from isogal.sensors.reduction import Reduction, State


def reading_covariance(
    instrument: Gravimeter, time: Array, sigma: Array, velocity: Array
) -> Array | None:
    """Return (T, T) the covariance of the readings' noise: white, correlated in time, what the
    vehicle's accelerations add, and what a platform that is not level does; None where it is
    white.

    The walk of the bias is not in it, which is a state (`pmht.rows`), nor is the mean of
    the platform's error (`platform.mean_error`).

    Parameters
    ----------
    time, sigma : (T,) arrays
        s; 1-sigma of the white noise.
    velocity : (T, 2) array
        m/s, north and east, at the stamps.
    """
    if not (instrument.correlated_sigma or instrument.cross_coupling or instrument.platform_tilt):
        return None
    covariance = np.diag(sigma**2)
    if instrument.correlated_sigma > 0.0:
        covariance += time_covariance(
            instrument.correlated_sigma, instrument.correlation_time, time
        )
    if instrument.cross_coupling > 0.0 and len(time) > 1:
        moving = instrument.cross_coupling * accelerations(time, velocity)
        covariance += moving @ moving.T
    if instrument.platform_tilt > 0.0:
        covariance += _levelling_covariance(instrument, time, velocity)
    return covariance


def _levelling_covariance(instrument: Gravimeter, time: Array, velocity: Array) -> Array:
    """Return (T, T) the covariance of what the platform's tilt does (docs/mathematics.md, section
    2.8)."""
    covariance = time_covariance(mean_error(instrument), 0.5 * instrument.platform_time, time)
    if len(time) > 1:
        force = np.gradient(velocity, time, axis=0)
        tilt = time_covariance(instrument.platform_tilt, instrument.platform_time, time)
        covariance += force @ force.T * tilt
    return covariance


def time_covariance(sigma: float, correlation_time: float, time: Array) -> Array:
    """Return (T, T) sigma² exp(-|dt| / correlation_time)."""
    return np.asarray(sigma**2 * np.exp(-np.abs(time[:, None] - time) / correlation_time))


def height_covariance(settings: Height, reduction: Reduction, time: Array, at: State) -> Array:
    """Return (T, T) the covariance of what an error of the measured height makes of reduced
    readings (docs/mathematics.md, section 3.11).

    Parameters
    ----------
    at : State
        Of T readings, as measured and estimated.
    """
    share = settings.scale * np.asarray(at.height)
    error = settings.bias**2 + np.outer(share, share)
    if settings.weather_sigma > 0.0:
        error = error + time_covariance(settings.weather_sigma, settings.weather_time, time)
    slope = reduction.height_slope(at)
    return np.asarray(slope[:, None] * slope * error)
