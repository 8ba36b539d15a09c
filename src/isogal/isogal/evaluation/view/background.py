"""The map behind the tracks: a shaded picture, and lines of equal value."""

import base64
import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Booleans
from isogal.evaluation.figures.style import FieldScale, nice_limit
from isogal.evaluation.view.projection import Projection
from isogal.maps.corridor import corridor_of

if TYPE_CHECKING:
    from isogal.maps.tiled_map import ScalarMap

Bytes = NDArray[np.uint8]

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
    field_map: "ScalarMap", projection: Projection, latitude: Array, longitude: Array,
    scale: FieldScale,
) -> Background:  # fmt: skip
    """Return the map about a route, with a margin of a tenth of its length, 10 km at least.

    Parameters
    ----------
    field_map : ScalarMap
    projection : Projection
    latitude, longitude : (K,) arrays
        Of the route, rad.
    scale : FieldScale
        Of the map's values.
    """
    x, y = projection(latitude, longitude)
    margin = max(10.0, 0.15 * math.hypot(np.ptp(x), np.ptp(y)))
    window = corridor_of(latitude, longitude, 1e3 * margin).window
    part = field_map.overview(DOTS, window)
    east, north = projection.axes(part.latitude, part.longitude)
    values = scale(part.values)
    low, high = (float(v) for v in np.nanpercentile(values, [1.0, 99.0]))
    if not high > low:
        low, high = low - 0.5, high + 0.5
    step = nice_limit((high - low) / LINES)
    half = 0.5 * (east[1] - east[0]), 0.5 * (north[1] - north[0])
    return Background(
        _png(_shaded(values, east, north, low, high)),
        float(east[0] - half[0]),
        float(north[0] - half[1]),
        float(east[-1] - east[0] + 2.0 * half[0]),
        float(north[-1] - north[0] + 2.0 * half[1]),
        low,
        high,
        _lines(east, north, values, step),
        _near_lines(field_map, projection, scale, (latitude, longitude), step),
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


def _png(pixels: Bytes) -> str:
    from PIL import Image

    buffer = io.BytesIO()
    picture = Image.fromarray(pixels, "RGBA")
    picture.quantize(256, method=Image.Quantize.FASTOCTREE).save(
        buffer, format="PNG", optimize=True
    )
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _near_lines(
    field_map: "ScalarMap",
    projection: Projection,
    scale: FieldScale,
    route: tuple[Array, Array],
    step: float,
) -> Lines:
    """Return lines of the map's full resolution near the route, at most `step` apart in value;
    none of a map that is read piece by piece."""
    from isogal.maps.field_map import FieldMap

    if not isinstance(field_map, FieldMap):
        return Lines(np.empty(0), np.empty(0), step)
    part = field_map.window(*corridor_of(*route, 1e3 * NEAR).window[:4])
    east, north = projection.axes(part.latitude, part.longitude)
    values = np.where(_near(east, north, projection(*route)), scale(part.values), np.nan)
    slope = np.hypot(*np.gradient(values, north, east))
    usual = float(np.nanmedian(slope)) if np.isfinite(slope).any() else 0.0
    step = min(step, nice_limit(APART * usual)) if usual > 0.0 else step
    return _lines(east, north, values, step)


def _near(east: Array, north: Array, route: tuple[Array, Array]) -> Booleans:
    """Return which nodes lie within `NEAR` of the places of a route."""
    from scipy.ndimage import distance_transform_edt

    step = east[1] - east[0], north[1] - north[0]
    x, y = route
    away = np.ones((north.size, east.size), dtype=np.bool_)
    columns = np.clip(np.round((x - east[0]) / step[0]).astype(int), 0, east.size - 1)
    rows = np.clip(np.round((y - north[0]) / step[1]).astype(int), 0, north.size - 1)
    away[rows, columns] = False
    return distance_transform_edt(away, sampling=(step[1], step[0])) <= NEAR


def _lines(east: Array, north: Array, values: Array, step: float) -> Lines:
    from bokeh.plotting.contour import contour_data

    known = values[np.isfinite(values)]
    levels = (
        step * np.arange(math.ceil(known.min() / step), math.floor(known.max() / step) + 1)
        if known.size
        else np.empty(0)
    )
    if levels.size == 0 or min(values.shape) < 2:
        return Lines(np.empty(0), np.empty(0), step)
    masked = np.ma.masked_invalid(values)
    found = contour_data(east, north, masked, levels, want_fill=False, want_line=True).line_data
    x, y = (
        np.concatenate([np.append(level, np.nan) for level in levels_of])
        for levels_of in (found.xs, found.ys)
    )
    return Lines(x.astype(np.float32), y.astype(np.float32), step)
