"""The map behind the tracks: a shaded picture, and lines of equal value."""

import base64
import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Booleans
from isogal.earth.plane import Plane
from isogal.evaluation.figures.style import FieldScale, nice_limit
from isogal.evaluation.figures.track import image_edges
from isogal.evaluation.view.payload import in_km
from isogal.maps.corridor import corridor_of
from isogal.maps.field_map import FieldMap

if TYPE_CHECKING:
    from isogal.maps.tiled_map import ScalarMap

DOTS = 900
"""Rows and columns of the picture at most."""
LINES = 12
"""Lines of equal value over the whole map, about."""
APART = 0.5
"""km between the finer lines near the route, where the map is as steep as it usually is there."""
NEAR = 8.0
"""km from the route within which the finer lines are drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Lines of equal value: km east and north, one after the other with NaN between."""

    x: Array
    y: Array
    step: float
    """Between lines, in the scale's unit."""


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """The map in the page. km."""

    picture: str
    """Data URL of a PNG, the north above."""
    west: float
    south: float
    width: float
    height: float
    low: float
    """Value of the darkest colour, in the scale's unit."""
    high: float
    coarse: Lines
    fine: Lines


def background(
    field_map: "ScalarMap", plane: Plane, route: tuple[Array, Array], scale: FieldScale
) -> Background:
    """Return the map about a route, with a margin of a tenth of its length, 10 km at least.

    Parameters
    ----------
    field_map : ScalarMap
    plane : Plane
        Of the route.
    route : pair of (K,) arrays
        Latitude and longitude, rad.
    scale : FieldScale
        Of the map's values.
    """
    margin = max(10.0, 0.15 * math.hypot(*np.ptp(in_km(plane, *route), axis=0)))
    part = field_map.overview(DOTS, corridor_of(*route, 1e3 * margin).window)
    east, north = _axes(plane, part)
    values = scale(part.values)
    low, high = (float(v) for v in np.nanpercentile(values, [1.0, 99.0]))
    if not high > low:
        low, high = low - 0.5, high + 0.5
    step = nice_limit((high - low) / LINES)
    (west, right), (south, top) = image_edges(east), image_edges(north)
    return Background(
        _png(_shaded(values, east, north, low, high)),
        west,
        south,
        right - west,
        top - south,
        low,
        high,
        _lines(east, north, values, step),
        _near_lines(field_map, plane, route, scale, step),
    )


def _shaded(
    values: Array, east: Array, north: Array, low: float, high: float
) -> NDArray[np.uint8]:
    """Return RGBA bytes (n, m, 4), first row in the north: colour by value, lit from the
    north-west as relief is on maps; nothing where there is no map."""
    from bokeh.palettes import Cividis256

    palette = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in Cividis256], float)
    known = np.isfinite(values)
    filled = np.where(known, values, np.median(values[known]))
    index = np.clip((filled - low) / (high - low) * 255.0, 0, 255).astype(int)
    slope_north, slope_east = np.gradient(filled, north, east)
    typical = float(np.sqrt(np.mean(slope_north**2 + slope_east**2))) or 1.0
    light = (slope_east - slope_north) / (math.sqrt(2.0) * typical)
    shade = 1.0 - 0.16 * np.tanh(light)  # slopes that face north-west are bright
    colours = np.clip(palette[index] * shade[..., None], 0, 255).astype(np.uint8)
    return np.dstack([colours, np.where(known, 255, 0).astype(np.uint8)])[::-1]


def _png(pixels: NDArray[np.uint8]) -> str:
    from PIL import Image

    buffer = io.BytesIO()
    picture = Image.fromarray(pixels, "RGBA").quantize(256, method=Image.Quantize.FASTOCTREE)
    picture.save(buffer, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _near_lines(
    field_map: "ScalarMap",
    plane: Plane,
    route: tuple[Array, Array],
    scale: FieldScale,
    step: float,
) -> Lines:
    """Return lines of the map's full resolution near the route, at most `step` apart in value;
    none of a map that is read piece by piece."""
    if not isinstance(field_map, FieldMap):
        return Lines(np.empty(0), np.empty(0), step)
    part = field_map.window(*corridor_of(*route, 1e3 * NEAR).window[:4])
    east, north = _axes(plane, part)
    values = np.where(_near(east, north, in_km(plane, *route)), scale(part.values), np.nan)
    slope = np.hypot(*np.gradient(values, north, east))
    usual = float(np.nanmedian(slope)) if np.isfinite(slope).any() else 0.0
    step = min(step, nice_limit(APART * usual)) if usual > 0.0 else step
    return _lines(east, north, values, step)


def _axes(plane: Plane, part: FieldMap) -> tuple[Array, Array]:
    """Return km east and north of a map's columns and rows."""
    east = in_km(plane, plane.latitude, part.longitude)[:, 0]
    return east, in_km(plane, part.latitude, plane.longitude)[:, 1]


def _near(east: Array, north: Array, route: Array) -> Booleans:
    """Return which nodes lie within `NEAR` of the places (K, 2) of a route."""
    from scipy.ndimage import distance_transform_edt

    away = np.ones((north.size, east.size), dtype=np.bool_)
    step = np.array([east[1] - east[0], north[1] - north[0]])
    nodes = np.round((route - (east[0], north[0])) / step).astype(int)
    columns, rows = np.clip(nodes, 0, (east.size - 1, north.size - 1)).T
    away[rows, columns] = False
    return distance_transform_edt(away, sampling=step[::-1]) <= NEAR


def _lines(east: Array, north: Array, values: Array, step: float) -> Lines:
    from bokeh.plotting.contour import contour_data

    masked = np.ma.masked_invalid(values)
    levels = known = masked.compressed()
    if known.size:
        low, high = math.ceil(known.min() / step), math.floor(known.max() / step)
        levels = step * np.arange(low, high + 1)
    if levels.size == 0 or min(values.shape) < 2:
        return Lines(np.empty(0), np.empty(0), step)
    found = contour_data(east, north, masked, levels, want_fill=False, want_line=True).line_data
    x, y = (
        np.concatenate([np.append(level, np.nan) for level in levels_of])
        for levels_of in (found.xs, found.ys)
    )
    return Lines(x.astype(np.float32), y.astype(np.float32), step)
