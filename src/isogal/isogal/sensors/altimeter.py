"""The clearance meter: a radar or laser that looks straight down from the vehicle to the ground.

Terrain height is the navigator's height less the clearance. The navigator knows its height from
another source (docs/mathematics.md, section 3.4), and the error of that height is an error of the
reading. Heights are above the map's zero: where the navigator's height is ellipsoidal and the
map's above sea level, the geoid between them is an offset that `matcher.bias_sigma` has to allow
for.

A sounder or altimeter may have several beams: multibeam echo sounder, the four beams of a Doppler
log, a scanning laser (docs/mathematics.md, section 2.7). A beam meets the ground beside the
vehicle, where its range and direction say. Its reading is so one of the terrain at another place,
and that place moves with the navigator's error as the vehicle's own does. The navigator's error of
attitude, which turns the beams, is left out: 1e-4 rad of tilt are 0.1 m at a range of 1 km."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.scenario import Altimeter
from isogal.sensors.reduction import Reduction, State


class TerrainReduction(Reduction):
    """Clearance (m) to terrain height (m).

    Parameters
    ----------
    settings : scenario.Altimeter
    """

    def __init__(self, settings: Altimeter) -> None:
        self.settings = settings

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the clearance above terrain of a height; raises InputError where the vehicle is
        not above it."""
        clearance = np.asarray(at.height, dtype=float) - np.asarray(value)
        if (clearance <= 0.0).any():
            i = int(np.argmin(clearance))
            latitude, longitude, height = (
                np.broadcast_to(x, clearance.shape).flat[i] for x in at[:3]
            )
            raise InputError(
                f"route.height: the vehicle is {-float(clearance.flat[i]):.0f} m below the terrain"
                f" at latitude {np.degrees(latitude):.4f}, longitude {np.degrees(longitude):.4f}"
                f" deg, where it flies at {height:.0f} m"
            )
        return clearance

    def report(self, raw: ArrayLike) -> Array:
        """Return a clearance in single precision, as sensor_msgs/Range carries it; NaN out of
        range."""
        single = np.asarray(raw, dtype=np.float32).astype(np.float64)
        outside = (single < self.settings.min_range) | (single > self.settings.max_range)
        return np.where(outside, np.nan, single)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return terrain height: estimated height less clearance."""
        return np.asarray(at.height, dtype=float) - np.asarray(raw)

    def height_slope(self, at: State) -> Array:
        """Return one: an error of height is one of terrain height."""
        return np.ones(np.shape(at.latitude))


PARTS = 4
"""Numbers of a reduced beam: terrain height, and its footprint north, east and down of the
vehicle, m."""


def beam_directions(settings: Altimeter) -> Array:
    """Return (B, 3) unit vectors of the beams, body axes forward, right, down, the steepest
    first: as the scenario has them, or a fan across the track."""
    if settings.directions is not None:
        azimuth, slant = np.radians(np.array(settings.directions)).T
    else:
        half = np.radians(settings.opening) / 2.0 if settings.beams > 1 else 0.0
        across = np.linspace(-half, half, settings.beams)
        azimuth, slant = np.copysign(np.pi / 2.0, across), np.abs(across)
    order = np.argsort(slant.round(9), kind="stable")
    azimuth, slant = azimuth[order], slant[order]
    return np.stack(
        [np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), np.cos(slant)], axis=-1
    )


def thinned(vectors: Array, count: int) -> Array:
    """Return (count, 3) of an instrument's soundings (N, 3) m, evenly, the steepest first; with
    NaN where there are fewer."""
    if len(vectors) == count:
        return vectors
    met = vectors[np.isfinite(vectors).all(axis=-1)]
    if len(met) > count:
        met = met[np.linspace(0, len(met) - 1, count).round().astype(int)]
    slant = np.hypot(met[:, 0], met[:, 1]) / np.maximum(met[:, 2], 1e-9)
    found = np.full((count, 3), np.nan)
    found[: len(met)] = met[np.argsort(slant, kind="stable")]
    return found


class BeamReduction(TerrainReduction):
    """Soundings (..., B, 3), m from the vehicle to the ground in body axes, to terrain heights
    with their footprints (..., B, `PARTS`).

    Parameters
    ----------
    settings : scenario.Altimeter
    """

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the clearance straight down: what a single beam would measure."""
        return np.asarray(at.height, dtype=float) - np.asarray(value)

    def report(self, raw: ArrayLike) -> Array:
        """Return soundings in single precision, as messages carry them; NaN out of range."""
        single = np.asarray(raw, dtype=np.float32).astype(np.float64)
        length = np.sqrt((single**2).sum(axis=-1, keepdims=True))
        outside = (length < self.settings.min_range) | (length > self.settings.max_range)
        return np.where(outside, np.nan, single)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return terrain heights with their footprints, by the navigator's height and attitude."""
        if at.attitude is None:
            raise ValueError("several beams need the vehicle's attitude")
        met = np.einsum("...ij,...bj->...bi", np.asarray(at.attitude), np.asarray(raw))
        height = np.asarray(at.height, dtype=float)[..., None] - met[..., 2]
        return np.concatenate([height[..., None], met], axis=-1)
