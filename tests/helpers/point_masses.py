"""Fields of point masses below flat ground or mountains, as maps, for tests of continuation."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from helpers.batches import field_map_of
from isogal.maps.field_map import FieldMap

MGAL = 1e-5
HALF, STEP = 50e3, 500.0
SIDE = np.arange(-HALF, HALF + STEP / 2, STEP)


def sources(seed=5, count=100, shallowest=1500.0):
    """North, east, depth and GM of point masses below the ground."""
    draw = np.random.default_rng(seed)
    north, east = draw.uniform(-0.7 * HALF, 0.7 * HALF, (2, count))
    depth = draw.uniform(shallowest, 5e3, count)
    return north, east, depth, draw.standard_normal(count) * depth**2 * 5 * MGAL


def attraction(height, ground=None, **keys):
    """Downward attraction (n, m) of the masses at heights (n, m) or a height; their depths count
    from the ground above them."""
    if ground is None:
        return _above_flat_ground(float(height), **keys).copy()
    return _attraction(height, ground, **keys)


@lru_cache(maxsize=16)
def _above_flat_ground(height, **keys):
    return _attraction(height, None, **keys)


def _attraction(height, ground, **keys):
    total = np.zeros((SIDE.size, SIDE.size))
    for north, east, depth, gm in zip(*sources(**keys), strict=True):
        node = tuple(np.rint((np.array([north, east]) + HALF) / STEP).astype(int))
        above = height + depth - (0.0 if ground is None else ground[node])
        horizontal = (SIDE[:, None] - north) ** 2 + (SIDE[None, :] - east) ** 2
        square = horizontal + above**2
        total += gm * above / (square * np.sqrt(square))
    return total


def map_of(values, **keys) -> FieldMap:
    """Map of a disturbance (n, m), m/s²."""
    return replace(
        field_map_of(lambda n, e: 0.0 * n * e, half=HALF, step=STEP, **keys), values=values
    )


def drawn_errors(seed, length=None, nodes=SIDE.size, step=STEP):
    """Errors (nodes, nodes) of a map, of 1-sigma one: white noise of the nodes, or a field with
    covariance exp(-d / L), by circulant embedding on a torus twice as large."""
    size = 2 * nodes
    draw = np.random.default_rng(seed).standard_normal((size, size))
    if length is not None:
        away = step * np.minimum(np.arange(size), size - np.arange(size))
        power = np.fft.fft2(np.exp(-np.hypot(away[:, None], away) / length)).real
        draw = np.fft.ifft2(np.sqrt(np.maximum(power, 0.0)) * np.fft.fft2(draw)).real
    return draw[:nodes, :nodes]


def mountains(rms=300.0, seed=3):
    """Fractal terrain (n, m), m, from zero to 2 km."""
    size = 2 * SIDE.size
    k = (
        2.0
        * np.pi
        * np.hypot(np.fft.fftfreq(size, STEP)[:, None], np.fft.rfftfreq(size, STEP)[None, :])
    )
    white = np.random.default_rng(seed).standard_normal((size, size))
    spectrum = np.fft.rfft2(white) * np.maximum(k, 2.0 * np.pi / 25e3) ** -2.0
    terrain = np.fft.irfft2(spectrum)[: SIDE.size, : SIDE.size]
    terrain *= rms / terrain.std()
    return terrain - terrain.min()


def rms(values) -> float:
    """Root mean square of what is not missing."""
    return float(np.sqrt(np.nanmean(np.square(values))))
