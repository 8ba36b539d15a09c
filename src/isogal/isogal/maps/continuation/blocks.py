"""From one level to another in blocks: a large map with little memory.

What the field at a height h above a place owes to values farther away than r falls as h / r, so a
block with a rim is continued by itself. What lies beyond the rim and is not known to it changes
the result by some 0.07 h / r of the field's standard deviation, over distances of about r
(measured on the maps of docs/maps.md with rims of 2.5 to 20 km and heights of 100 m to 1 km); that
is part of sigma. Holes do not spoil a block: they are filled with the nearest value, and what lies
near them is left out as at the map's edge."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from isogal.arrays import Array, Booleans, Values
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps import spectral
from isogal.maps.axes import Window, part_within
from isogal.maps.continuation.level import EDGE, FADING, OFFSET, at_level, to_level
from isogal.maps.error_spectrum import mixed_length
from isogal.maps.field_map import FieldMap
from isogal.maps.potential import disturbance_of

CONTINUED = (*FADING, *OFFSET, "gravity")
"""Quantities that `continued` takes: gravity by way of its disturbance."""
_SIDE_M = 200_000.0
_SIDE_CELLS = 500
"""Blocks are as large as both allow, and at least as large as their rim: many small ones with a
wide rim would compute each place of the map again and again."""
_LEAST_RIM, _WIDEST_RIM = 10_000.0, 50_000.0
"""m around a block."""
_RIM_HEIGHTS = 20.0
"""Rim in heights, within these limits."""
_BEYOND = 0.07
"""Error by what is beyond the rim, in standard deviations of the field times height over rim."""
_STRETCH = 0.15
"""Share by which the length of a degree of longitude may differ within a block and its rim."""
_Part = tuple[slice, slice]
"""Rows and columns."""


def rim_of(rise: float, cutoff: float | None = None) -> float:
    """Return how far (m) around a place its value after a rise (m) depends on the map."""
    rim = min(max(_LEAST_RIM, _RIM_HEIGHTS * abs(rise)), _WIDEST_RIM)
    return max(rim, EDGE * abs(rise), 3.0 * (cutoff or 0.0))


def continued(
    field_map: FieldMap,
    height: float,
    from_height: float,
    *,
    cutoff: float | None = None,
    window: Window | None = None,
) -> FieldMap:
    """Continue a map from a level to another.

    Parameters
    ----------
    field_map : FieldMap
        Of one of `CONTINUED`. Holes and whatever lies within five times the way of one, or of the
        map's end, have no value in the result.
    height, from_height : float
        m above the ellipsoid.
    cutoff : float, optional
        Wavelength (m) for the way down, see `isogal.maps.continuation.level`; None = the shortest
        at which no wave grows more than e times, but two cells at least.
    window : Window, optional
        Where the result is needed; None = everywhere. Blocks that do not touch it are left out:
        they have no value in the result.

    Returns
    -------
    FieldMap
        Sigma (uniform where the map's own is) and correlation length are those of the result.
        A map of gravity becomes normal gravity on the ellipsoid and the disturbance at the level,
        which is what gravity at the level is when the mean change with height is taken off.

    Raises
    ------
    InputError
        Nothing is left of the map, or it lies too near a pole.
    """
    rise = height - from_height
    if rise == 0.0:
        return field_map
    if rise < 0.0 and cutoff is None:
        cutoff = _shortest(field_map, -rise)
    if field_map.quantity == "gravity":  # by way of its disturbance
        result = continued(
            disturbance_of(field_map), height, from_height, cutoff=cutoff, window=window
        )
        normal = normal_gravity(field_map.latitude)[:, None]
        return replace(result, values=result.values + normal, quantity="gravity")
    where, rim = field_map.provenance or "map", rim_of(rise, cutoff)
    values, sigma, blocks = _in_blocks(field_map, (height, from_height), cutoff, window)
    if not np.isfinite(values).any():
        raise InputError(
            f"{where}: nothing is left of the map {EDGE * abs(rise):g} m from its edges and holes"
        )
    beyond = _BEYOND * abs(rise) / rim * float(np.nanstd(field_map.values))
    cells = sum(count for count, *_ in blocks)
    errors = [(count / cells * square, length) for count, square, length in blocks]
    errors.append((beyond**2, rim))
    mean_sigma = math.sqrt(sum(variance for variance, _ in errors))
    both = mean_sigma if sigma is None else np.hypot(sigma, beyond), mixed_length(errors)
    return at_level(field_map, values, both, height)


def _in_blocks(
    field_map: FieldMap,
    levels: tuple[float, float],
    cutoff: float | None,
    window: Window | None,
) -> tuple[Values, Array | None, list[tuple[int, float, float | None]]]:
    """Return values (n, m), sigma (n, m; None = uniform), and cells, mean square of sigma and
    correlation length of each block that touches a window."""
    where, rise = field_map.provenance or "map", levels[0] - levels[1]
    needed = part_within(field_map.latitude, field_map.longitude, window, where)
    wanted = np.zeros(field_map.shape, dtype=np.bool_)
    for columns in needed.columns:
        wanted[needed.rows, columns] = True
    values = np.full(wanted.shape, np.nan, dtype=field_map.values.dtype)
    sigma = np.zeros(wanted.shape) if np.ndim(field_map.sigma) else None
    blocks: list[tuple[int, float, float | None]] = []
    for inner, outer, within in _blocks(field_map, rim_of(rise, cutoff)):
        if not (wanted[inner].any() and np.isfinite(field_map.values[outer]).any()):
            continue
        part = field_map.part(*outer)
        missing = ~np.isfinite(part.values)
        kept = spectral.rim_distance(missing, part) > EDGE * abs(rise)
        part = to_level(_without_holes(part, missing), *levels, cutoff=cutoff, edge=0.0)
        values[inner] = np.where(kept, part.values, np.nan)[within]
        if sigma is not None:
            sigma[inner] = np.asarray(part.sigma)[within]
        mean_square = float(np.nanmean(np.square(part.sigma)))
        blocks.append((values[inner].size, mean_square, part.correlation_length))
    return values, sigma, blocks


def _shortest(field_map: FieldMap, depth: float) -> float:
    """Return the wavelength (m) to cut off at on the way down by a depth (m)."""
    ends = field_map.latitude[[0, -1]]
    cell = max(max(field_map.cell_size_m(float(latitude))) for latitude in ends)
    return max(2.01 * cell, 2.0 * math.pi * depth)


def _without_holes(part: FieldMap, missing: Booleans) -> FieldMap:
    """Return a map whose holes have the nearest values."""
    if not missing.any():
        return part
    from scipy.ndimage import distance_transform_edt

    nearest = tuple(distance_transform_edt(missing, return_distances=False, return_indices=True))
    sigma = part.sigma if isinstance(part.sigma, float) else part.sigma[nearest]
    return replace(part, values=part.values[nearest], sigma=sigma)


def _blocks(field_map: FieldMap, rim: float) -> Iterator[tuple[_Part, _Part, _Part]]:
    """Yield blocks that cover a map: each in the map, with a rim (m) as far as the map reaches,
    and where the block is in that."""
    n, m = field_map.shape
    farthest = float(np.abs(field_map.latitude[[0, -1]]).max())
    cell = field_map.cell_size_m(farthest)
    # cos(latitude) changes by the share tan(latitude) * d(latitude)
    tallest = _STRETCH * 6.371e6 / max(math.tan(min(farthest, 1.57)), 1e-3) - 2.0 * rim
    rows, columns = (
        max(8, min(max(_SIDE_CELLS, int(rim / size)), int(limit / size)))
        for limit, size in zip((min(max(_SIDE_M, rim), tallest), 1e9), cell, strict=True)
    )
    more = [math.ceil(rim / size) + 1 for size in cell]
    for top in range(0, n, rows):
        for side in range(0, m, columns):
            inner = slice(top, min(top + rows, n)), slice(side, min(side + columns, m))
            first = max(top - more[0], 0), max(side - more[1], 0)
            outer = (
                slice(first[0], inner[0].stop + more[0]),
                slice(first[1], inner[1].stop + more[1]),
            )
            within = (
                slice(top - first[0], inner[0].stop - first[0]),
                slice(side - first[1], inner[1].stop - first[1]),
            )
            yield inner, outer, within
