"""The layout of GGMplus (Hirt et al. 2013, doi:10.1002/grl.50838; docs/mathematics.md, section
12.2): which tiles there are, how they are named, and what their numbers mean.

Tiles of 5° x 5° with 2500 x 2500 cells are named by their south-west corner (``S40E145.ga``). They
have no header; big-endian whole numbers, latitude running fastest (south to north), then longitude
(west to east); cell centres at corner + 0.001 + 0.002 i degrees, GRS80."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.maps.axes import MARGIN, TWO_PI, Window
from isogal.maps.field_map import FieldMap
from isogal.maps.quantities import QUANTITIES

Tile = tuple[int, int]
"""South-west corner, deg; the synthetic map has tiles of the same cells, too."""

STEP_DEG = 0.002
CELLS = 2500
SIZE_DEG = 5
PER_DEGREE = CELLS // SIZE_DEG
_ACROSS, _UP = 360 * PER_DEGREE, 180 * PER_DEGREE


@dataclass(frozen=True)
class Kind:
    """One kind of GGMplus file."""

    quantity: str
    dtype: str
    no_data: int
    step: float
    """Of the numbers, in the quantity's unit."""


_ARCSEC = math.pi / 648000.0
KINDS = {
    "ga": Kind("gravity", ">i4", -(2**31), 1e-6),
    "dg": Kind("disturbance", ">i2", -(2**15), 1e-6),
    "xi": Kind("deflection_north", ">i2", -(2**15), 0.1 * _ARCSEC),
    "eta": Kind("deflection_east", ">i2", -(2**15), 0.1 * _ARCSEC),
    "ha": Kind("geoid", ">i4", -(2**31), 1e-3),
}
"""By file name extension; ``ha`` is the height anomaly (quasigeoid)."""
NAME = re.compile(r"([NS])(\d\d)([EW])(\d\d\d)\.(ga|dg|xi|eta|ha)")
"""File names of tiles; the last group is the extension."""


def tile_name(south: int, west: int, extension: str) -> str:
    """Return the file name of the tile with this south-west corner (deg)."""
    vertical, horizontal = "S" if south < 0 else "N", "W" if west < 0 else "E"
    return f"{vertical}{abs(south):02d}{horizontal}{abs(west):03d}.{extension}"


def corner_of(name: str) -> Tile:
    """Return the south-west corner (deg) of a tile by its file name."""
    south, west = int(name[1:3]), int(name[4:7])
    return -south if name[0] == "S" else south, -west if name[3] == "W" else west


def tiles_of(window: Window) -> list[Tile]:
    """Return all tiles that a window touches."""
    return list(places_of(*cells_of(window), SIZE_DEG))


def places_of(rows: range, columns: range, side: int) -> dict[Tile, list[tuple[int, int]]]:
    """Return the tiles of a side (deg) that some cells (`cells_of`) lie in, and at which of these
    rows and columns each has its first cell: at several, where the columns go round the Earth."""
    places: dict[Tile, list[tuple[int, int]]] = {}
    cells = side * PER_DEGREE
    for row in range(rows.start // cells, -(-rows.stop // cells)):
        for column in range(columns.start // cells, -(-columns.stop // cells)):
            tile = side * row - 90, (side * column + 180) % 360 - 180
            place = row * cells - rows.start, column * cells - columns.start
            places.setdefault(tile, []).append(place)
    return places


def overlap(
    values: Array, tile: NDArray[np.integer], place: tuple[int, int]
) -> tuple[Array, NDArray[np.integer]]:
    """Return the parts of values (n, m) and of a tile that are the same cells, as views; the first
    cell of the tile belongs at row, column `place`."""
    top, left = place
    there = values[max(top, 0) : top + len(tile), max(left, 0) : left + tile.shape[1]]
    return there, tile[max(-top, 0) :, max(-left, 0) :][: there.shape[0], : there.shape[1]]


def map_of_cells(
    rows: range, columns: range, values: Array, quantity: str, step: float, provenance: str
) -> FieldMap:
    """Return a map of values (n, m), unit inside, that are kept in steps, on some cells."""
    unit = QUANTITIES[quantity].unit
    return FieldMap(
        np.radians(-90.0 + STEP_DEG * (np.array(rows) + 0.5)),
        np.radians(STEP_DEG * (np.array(columns) + 0.5)),
        values,
        unit=unit,
        quantity=quantity,
        quantisation=step,
        provenance=provenance,
        file_unit=unit,
    )


def cells_of(window: Window) -> tuple[range, range]:
    """Return rows (from the south pole) and columns (from Greenwich, continuous) of a window and
    its margin."""
    south, north, west, east = window[:4]
    if east < west:
        east = west + (east - west) % TWO_PI
    south, north, west, east = (
        math.floor(math.degrees(x) / STEP_DEG) for x in (south, north, west, east)
    )
    rows = range(max(south + _UP // 2 - MARGIN, 0), min(north + _UP // 2 + MARGIN + 1, _UP))
    left = west - MARGIN
    return rows, range(left, min(east + MARGIN + 1, left + _ACROSS))


def extent_of(names: Iterable[str]) -> Window:
    """Return the window of all these tiles, without a margin beyond them."""
    lats, lons = zip(*map(corner_of, names), strict=True)
    inside = (MARGIN + 0.5) * STEP_DEG
    return Window(
        math.radians(min(lats) + inside),
        math.radians(max(lats) + SIZE_DEG - inside),
        math.radians(min(lons) + inside),
        math.radians(max(lons) + SIZE_DEG - inside),
    )
