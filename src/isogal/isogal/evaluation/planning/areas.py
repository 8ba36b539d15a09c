"""Areas that a route must keep out of: polygons of a GeoJSON file (RFC 7946)."""

from pathlib import Path
from typing import Any

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.errors import InputError
from isogal.evaluation.results import read_json

Rings = list[Array]
"""Outer ring and holes of a polygon, (K, 2) longitude and latitude, deg."""


def read_areas(path: Path) -> list[Rings]:
    """Return the polygons of a file.

    Raises
    ------
    InputError
        The file cannot be read, is not GeoJSON or has no polygon.
    """
    data = read_json(path)
    try:
        polygons = [
            [np.array(ring, dtype=np.float64)[:, :2] for ring in rings]
            for rings in _polygons(data)
        ]
    except (KeyError, TypeError, ValueError, IndexError, AttributeError):
        raise InputError(f"{path}: is not GeoJSON with coordinates of polygons") from None
    if not polygons:
        raise InputError(f"{path}: has no polygon")
    return polygons


def _polygons(item: Any) -> list[Any]:
    kind = item["type"]
    if kind == "FeatureCollection":
        return [p for feature in item["features"] for p in _polygons(feature)]
    if kind == "Feature":
        return _polygons(item["geometry"])
    if kind == "GeometryCollection":
        return [p for geometry in item["geometries"] for p in _polygons(geometry)]
    if kind == "Polygon":
        return [item["coordinates"]]
    return list(item["coordinates"]) if kind == "MultiPolygon" else []


def inside(areas: list[Rings], latitude: Array, longitude: Array) -> Booleans:
    """Return whether places (rad, any shape) lie in one of the areas: within an odd number of the
    rings of a polygon."""
    from matplotlib.path import Path as Outline

    places = np.degrees(np.stack([longitude, latitude], axis=-1)).reshape(-1, 2)
    found = np.zeros(len(places), dtype=np.bool_)
    for rings in areas:
        within = [Outline(ring).contains_points(places) for ring in rings]
        found |= np.logical_xor.reduce(within)
    return found.reshape(np.shape(latitude))
