"""Recorded tracks made up for tests: a field, a true track over it, and where a navigator said it
was."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.maps.field_map import FieldMap
from isogal.tracks.track import Track

FIELDS = {
    "gravity": ("m/s²", 1.0, 9.8),
    "disturbance": ("m/s²", 1.0, 0.0),
    "magnetic_anomaly": ("nT", 1e6, 0.0),
    "height": ("m", 3e6, 200.0),
}
"""Quantity: unit, factor on the 10 mGal RMS of `wavy`, offset. So 100 nT and 300 m RMS."""


def field_of(quantity: str, **keys) -> FieldMap:
    """A rough map of a quantity, 80 km wide."""
    from dataclasses import replace

    unit, factor, offset = FIELDS[quantity]
    field_map = field_map_of(wavy)
    return replace(
        field_map,
        values=offset + factor * field_map.values,
        unit=unit,
        quantity=quantity,
        file_unit=unit,
        provenance=f"{quantity}.nc",
        **keys,
    )


def made_track(
    field_map: FieldMap,
    count: int = 60,
    error: ArrayLike = (0.0, 0.0),
    sigma: float = 1e-5,
    seed: int = 0,
    start: tuple[float, float] = (-10e3, -12e3),
    step: tuple[float, float] = (140.0, 170.0),
    **keys,
) -> tuple[Track, np.ndarray, np.ndarray]:
    """A straight track with a constant position error (north, east m); also returns the true
    latitude and longitude (rad)."""
    north, east = metres_per_radian(ORIGIN[0])
    position = np.array(start) + np.array(step) * np.arange(count)[:, None]
    latitude, longitude = ORIGIN[0] + position[:, 0] / north, ORIGIN[1] + position[:, 1] / east
    error = np.asarray(error)
    local = metres_per_radian(latitude)
    noise = sigma * np.random.default_rng(seed).standard_normal(count)
    track = Track(
        time=10.0 * np.arange(count) + 5.0,
        latitude=latitude + error[0] / local[0],
        longitude=longitude + error[1] / local[1],
        value=field_map.value(latitude, longitude) + noise,
        sigma=np.full(count, sigma),
        offset=np.zeros(count),
        where="track.csv",
        **keys,
    )
    return track, latitude, longitude


def write_csv(
    path: Path, track: Track, columns: str = "time,latitude,longitude,value", factor: float = 1.0
) -> Path:
    """Write a track as CSV; values in units of `factor`."""
    known = {
        "time": track.time,
        "latitude": np.degrees(track.latitude),
        "longitude": np.degrees(track.longitude),
        "value": track.value / factor,
        "sigma": track.sigma / factor,
        "offset": track.offset / factor,
    }
    names = columns.split(",")
    rows = np.stack([known[name] for name in names], axis=1)
    path.write_text(
        "\n".join([columns, *(",".join(f"{x:.12g}" for x in row) for row in rows)]) + "\n"
    )
    return path


def squared_distance(fix: dict, latitude: float, longitude: float) -> float:
    """Squared distance of a fix (as `isogal match` writes it) from the truth (rad) in units of its
    covariance: chi-square of 2 degrees of freedom."""
    place = np.radians([fix["latitude"], fix["longitude"]])
    north, east = horizontal_difference(*place, latitude, longitude)
    apart = np.array([east, north])
    return float(apart @ np.linalg.solve(fix["covariance_enu"], apart))
