"""Surveys drawn from a field whose covariance is known."""

from collections.abc import Iterator

import numpy as np
import pytest

from isogal.maps.gridding import learning
from isogal.maps.gridding.survey import Survey

LATITUDE, LONGITUDE = np.radians(-36.5), np.radians(147.0)
NORTH, EAST = 6.36e6, 6.37e6 * np.cos(LATITUDE)


def matern(places, others, sigma, length):
    """Covariance of the field between places (N, 2) and (M, 2)."""
    a = np.sqrt(3.0) / length * np.hypot(*(places[:, None] - others).T).T
    return sigma**2 * (1.0 + a) * np.exp(-a)


def drawn(places, seed, *, sigma=1e-4, length=3000.0, noise=2e-6):
    """Field (N,) at places (N, 2), and readings of it."""
    random = np.random.default_rng(seed)
    covariance = matern(places, places, sigma, length) + 1e-8 * sigma**2 * np.eye(len(places))
    field = np.linalg.cholesky(covariance) @ random.standard_normal(len(places))
    return field, field + noise * random.standard_normal(len(places))


def survey_at(places, value, **columns):
    """Survey of readings at places (N, 2): east, north, m."""
    return Survey(
        LATITUDE + places[:, 1] / NORTH,
        LONGITUDE + places[:, 0] / EAST,
        np.asarray(value),
        unit="m/s²",
        quantity="disturbance",
        where="survey",
        file_unit="m/s²",
        **columns,
    )


def scattered(count, half, seed):
    """Places (N, 2) in a square."""
    return np.random.default_rng(seed).uniform(-half, half, (count, 2))


def flight_lines(count, spacing, along, half):
    """Places (N, 2) on lines to the east, and the number of each line."""
    east = np.arange(-half, half + 1.0, along)
    north = spacing * (np.arange(count) - 0.5 * (count - 1))
    return (
        np.stack([np.tile(east, count), np.repeat(north, east.size)], axis=1),
        np.repeat(np.arange(count), east.size),
    )


@pytest.fixture(scope="module", autouse=True)
def few_places() -> Iterator[None]:
    """Parameters learnt from two places, not ten, to which the time is in proportion; the fields
    above are the same everywhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learning, "_PLACES", 2)
        yield
