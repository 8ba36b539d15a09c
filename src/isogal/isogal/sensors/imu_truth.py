"""What a perfect IMU that is faster than the navigator measures on the true route."""

from functools import lru_cache

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import radii
from isogal.scenario import Route, Settings
from isogal.sensors.trajectory import drive, followed, sensor_means


def true_samples(settings: Settings) -> Array:
    """Return the means (K n, 6) of specific force (m/s²) and angular rate (rad/s), body axes, over
    each of n samples of K steps of the navigator.

    The route is that of `isogal.sensors.trajectory.build_trajectory`, whose steps are divided; it
    does not depend on the IMU's rate."""
    if settings.route.track is not None:
        return followed(settings).means
    return _divided(settings.route, settings.navigation_rate, settings.samples_per_step)


@lru_cache(maxsize=1)
def _divided(route: Route, rate: float, samples: int) -> Array:
    rows, rates = drive(route, rate)
    turn, acceleration = rates.T
    latitude, heading, speed = rows[:-1, 0], rows[:-1, 2], rows[:-1, 3]
    result = np.empty((len(rates), samples, 6))
    dt = 1.0 / (rate * samples)
    for j in range(samples):
        end = _latitude_after(latitude, heading, speed, rates, route.height, dt)
        start = np.stack([latitude, heading, speed], axis=1)
        force, angular_rate = sensor_means(start, end, rates, route.height, dt)
        result[:, j, :3], result[:, j, 3:] = force, angular_rate
        latitude, heading, speed = end, heading + turn * dt, speed + acceleration * dt
    return result.reshape(-1, 6)


def _latitude_after(
    latitude: Array, heading: Array, speed: Array, rates: Array, height: float, dt: float
) -> Array:
    """Return the latitudes (K,) after dt (s), by a fourth-order Runge-Kutta step."""
    turn, acceleration = rates.T

    def slope(at: Array, after: float) -> Array:
        v = speed + acceleration * after
        return np.asarray(v * np.cos(heading + turn * after) / (radii(at)[0] + height))

    half = 0.5 * dt
    a = slope(latitude, 0.0)
    b = slope(latitude + half * a, half)
    c = slope(latitude + half * b, half)
    d = slope(latitude + dt * c, dt)
    return latitude + dt / 6.0 * (a + 2.0 * b + 2.0 * c + d)
