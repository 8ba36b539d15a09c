"""Batches made up for the matchers' tests: a map, a true track over it, a navigator with a known
error."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import level
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.parameters import Parameters

ORIGIN = (np.radians(-36.5), np.radians(147.0))
INTERVAL = 10.0


def wavy(north: ArrayLike, east: ArrayLike) -> np.ndarray:
    """A rough field, m/s²: sums of waves of 3 to 25 km, about 10 mGal RMS."""
    north, east = np.asarray(north) / 1e3, np.asarray(east) / 1e3
    waves = np.random.default_rng(3)
    total = np.zeros(np.broadcast(north, east).shape)
    for length in np.geomspace(3.0, 25.0, 24):
        direction, phase = waves.uniform(0.0, 2.0 * np.pi, 2)
        total += length**0.7 * np.sin(
            2 * np.pi / length * (north * np.cos(direction) + east * np.sin(direction)) + phase
        )
    return 1e-5 * total


def _values(function: Callable[..., np.ndarray], half: float, step: float) -> np.ndarray:
    side = np.arange(-half, half + step / 2, step)
    return function(side[:, None], side[None, :]) + np.zeros((side.size, side.size))


_rough = lru_cache(maxsize=8)(_values)
"""The same for `wavy`, which many files of tests have."""


def field_map_of(
    function: Callable[..., np.ndarray], half: float = 40e3, step: float = 250.0, **keys
) -> FieldMap:
    """Map of a function of metres north and east of ORIGIN."""
    side = np.arange(-half, half + step / 2, step)
    metres = metres_per_radian(ORIGIN[0])
    made = _rough if function is wavy else _values
    values = made(function, half, step).copy()
    return FieldMap(
        ORIGIN[0] + side / metres[0],
        ORIGIN[1] + side / metres[1],
        values,
        "m/s²",
        "disturbance",
        **keys,
    )


@dataclass(frozen=True)
class Truth:
    latitude: float
    longitude: float

    def error_of(self, fix) -> np.ndarray:
        """North and east error of a fix, m."""
        metres = metres_per_radian(self.latitude)
        return np.array(
            [
                (fix.latitude - self.latitude) * metres[0],
                (fix.longitude - self.longitude) * metres[1],
            ]
        )


def make_batch(
    field_map: FieldMap,
    error=(0.0, 0.0, 0.0, 0.0),
    scans: int = 30,
    sigma: float = 1e-5,
    prior_sigma=(500.0, 0.05),
    start=(-3000.0, -3000.0),
    velocity=(14.0, 17.0),
    seed: int | None = 0,
    jacobian=(0.0, 0.0, 0.0, 0.0),
    **changes,
) -> tuple[Batch, Truth]:
    """A straight track over the map and a navigator with a constant velocity error.

    jacobian is d(reading)/d(position and velocity error at the scan); seed None = no noise.
    """
    xi = np.array(error)
    age = INTERVAL * np.arange(scans - 1, -1, -1.0)
    transition = np.zeros((scans, 2, 4))
    transition[:, 0, 0] = transition[:, 1, 1] = 1.0
    transition[:, 0, 2] = transition[:, 1, 3] = -age
    at_scan = np.concatenate([transition @ xi, np.broadcast_to(xi[2:], (scans, 2))], axis=1)
    metres = np.array(metres_per_radian(ORIGIN[0] + start[0] / metres_per_radian(ORIGIN[0])[0]))
    true = np.array(start) + np.array(velocity) * (INTERVAL * np.arange(scans))[:, None]
    middle = np.array(metres_per_radian(ORIGIN[0]))
    latitude, longitude = (
        np.array(ORIGIN) + np.array(start) / middle + (true - np.array(start)) / metres
    ).T
    # the navigator's error counts in metres at the navigator's own latitude
    there = np.stack(metres_per_radian(latitude + at_scan[:, 0] / metres[0]))
    noise = (
        np.zeros(scans)
        if seed is None
        else sigma * np.random.default_rng(seed).standard_normal(scans)
    )
    slope = np.einsum("i,tij->tj", np.array(jacobian)[:2], transition)
    slope[:, 2:] += np.array(jacobian)[2:]
    keys = {
        "time": 1000.0 + INTERVAL * np.arange(scans),
        "latitude": latitude + at_scan[:, 0] / there[0],
        "longitude": longitude + at_scan[:, 1] / there[1],
        "velocity": np.array(velocity) + at_scan[:, 2:],
        "reading": field_map.value(latitude, longitude) + slope @ xi + noise,
        "sigma": np.full(scans, sigma),
        "new": scans,
    }
    prior = changes.pop("prior", np.diag(np.repeat(np.square(prior_sigma), 2)))
    keys |= by_position_and_velocity(transition, slope, prior)
    return Batch(**(keys | changes)), Truth(latitude[-1], longitude[-1])


def noise_covariance(noise: Parameters | None, sigma: ArrayLike, time: ArrayLike) -> np.ndarray:
    """(T, T) covariance of readings with white noise of 1-sigmas (T,) and with what they have in
    common, at times (T,)."""
    sigma, time = np.asarray(sigma), np.asarray(time)
    covariance = np.diag(sigma**2)
    for k in range(0 if noise is None else len(noise.sigma)):
        column = noise.sigma[k] * noise.reading[:, k]
        together = np.exp(-np.abs(time[:, None] - time) / noise.times[k])
        covariance += np.outer(column, column) * together
    return covariance


def by_position_and_velocity(transition: ArrayLike, slope: ArrayLike, prior: ArrayLike) -> dict:
    """Columns of a batch of a navigator that knows its attitude: position error (T, 2, 4) and
    reading (T, 4) per unit of xi, whose covariance is (4, 4)."""
    transition, slope = np.asarray(transition), np.asarray(slope)
    backward = np.tile(np.eye(7), (len(transition), 1, 1))
    backward[:, :2, :4] = transition
    return {
        "covariance": level(np.asarray(prior)),
        "by_error": np.concatenate(
            [backward[:, :2], np.pad(slope, ((0, 0), (0, 3)))[:, None]], axis=1
        ),
        "backward": backward,
    }
