"""A smoothed voyage as CSV, GeoJSON and GPX."""

import json
import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from itertools import combinations_with_replacement
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.files import csv_text, geojson_line, write_atomic
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import matrix, to_angles

_START = datetime(1970, 1, 1, tzinfo=UTC)
"""What stamps count from, as ROS has it; of a simulation it is a day like any other."""
_DIGITS = 9
"""Decimals of degrees: 0.1 mm."""
_AXES = "north", "east", "down"
_UPPER = tuple(combinations_with_replacement(range(3), 2))


class SmoothedTrack(NamedTuple):
    """States of a voyage, as all its data have them."""

    time: Array
    """(K,) s."""
    states: Sequence[FilterState]
    """K of them."""


def as_csv(track: SmoothedTrack) -> str:
    """Return a table: time s, latitude, longitude deg, height m, velocity north, east, down m/s,
    roll, pitch, heading deg, and the covariance of the position (north, east, down, m²), of the
    horizontal velocity (m²/s²) and of the heading (deg²)."""
    return csv_text([_row(*one) for one in zip(track.time.tolist(), track.states, strict=True)])


def _row(time: float, state: FilterState) -> dict[str, str]:
    (latitude, longitude), P = _place(state), state.covariance
    angles = zip(("roll", "pitch", "heading"), to_angles(matrix(state.attitude)), strict=True)
    return {
        "time": f"{time:.9g}" if time < 1e6 else f"{time:.3f}",
        "latitude": f"{latitude:.{_DIGITS}f}",
        "longitude": f"{longitude:.{_DIGITS}f}",
        "height": f"{state.position[2]:.3f}",
        **{f"velocity_{axis}": f"{state.velocity[k]:.5f}" for k, axis in enumerate(_AXES)},
        **{name: f"{math.degrees(angle):.6f}" for name, angle in angles},
        **{f"covariance_{_AXES[i]}_{_AXES[j]}": f"{P[i, j]:.6g}" for i, j in _UPPER},
        "variance_velocity_north": f"{P[3, 3]:.6g}",
        "variance_velocity_east": f"{P[4, 4]:.6g}",
        "variance_heading": f"{math.degrees(math.degrees(P[8, 8])):.6g}",
    }


def as_geojson(track: SmoothedTrack) -> str:
    """Return a FeatureCollection (RFC 7946) of one line, whose properties hold the time (s) and
    the 1-sigma to north and east (m) of each point; in two pieces at longitude 180."""
    places = np.array([_place(state) for state in track.states]).reshape(-1, 2)
    heights = [round(float(state.position[2]), 3) for state in track.states]
    points = [
        [round(longitude, _DIGITS), round(latitude, _DIGITS), height]
        for (latitude, longitude), height in zip(places.tolist(), heights, strict=True)
    ]
    sigma = np.array([np.sqrt(np.diag(state.covariance)[:2]) for state in track.states])
    properties = {
        "time": track.time.tolist(),
        "sigma_north": sigma[:, 0].round(3).tolist(),
        "sigma_east": sigma[:, 1].round(3).tolist(),
    }
    feature = {"type": "Feature", "properties": properties, "geometry": geojson_line(points)}
    return json.dumps({"type": "FeatureCollection", "features": [feature]}) + "\n"


def as_gpx(track: SmoothedTrack) -> str:
    """Return a track of GPX 1.1 (Topografix 2004), heights above the ellipsoid, and times as if
    stamps were seconds since 1970."""
    points = []
    for time, state in zip(track.time.tolist(), track.states, strict=True):
        latitude, longitude = _place(state)
        when = (_START + timedelta(seconds=time)).isoformat(timespec="milliseconds")
        points.append(
            f'<trkpt lat="{latitude:.{_DIGITS}f}" lon="{longitude:.{_DIGITS}f}">'
            f"<ele>{state.position[2]:.3f}</ele>"
            f"<time>{when.replace('+00:00', 'Z')}</time></trkpt>\n"
        )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<gpx version="1.1" creator="isogal" xmlns="http://www.topografix.com/GPX/1/1">\n'
        f"<trk><name>smoothed</name><trkseg>\n{''.join(points)}</trkseg></trk>\n</gpx>\n"
    )


def write_smoothed(track: SmoothedTrack, folder: Path) -> list[Path]:
    """Write ``smoothed.csv``, ``.geojson`` and ``.gpx`` into a folder; return their paths."""
    texts = {"csv": as_csv(track), "geojson": as_geojson(track), "gpx": as_gpx(track)}
    paths = []
    for suffix, text in texts.items():
        paths.append(folder / f"smoothed.{suffix}")
        write_atomic(paths[-1], text)
    return paths


def _place(state: FilterState) -> tuple[float, float]:
    """Return latitude and longitude, deg, the latter within 180."""
    latitude, longitude, _ = state.position.tolist()
    return math.degrees(latitude), math.degrees(math.remainder(longitude, 2.0 * math.pi))
