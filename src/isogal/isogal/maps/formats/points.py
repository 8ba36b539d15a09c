"""From a list of points (longitude, latitude, value) that lie on a grid to the grid."""

import math
import re
import warnings
from collections.abc import Iterable

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.maps.axes import check_size


def grid_of_points(
    latitude: Array, longitude: Array, *columns: Array, where: str
) -> tuple[Array, ...]:
    """Arrange points that lie on a regular grid, in any order; nodes without a point are NaN.

    Parameters
    ----------
    latitude, longitude : (N,) deg
    columns : (N,) each
        Numbers at the points.
    where : str
        File, for messages.

    Returns
    -------
    latitude (n,), longitude (m,) in rad, increasing, and each of the columns (n, m)

    Raises
    ------
    InputError
        Points off a regular grid, the same node twice, coordinates that are none.
    """
    for name, axis, most in (("latitude", latitude, 90.0), ("longitude", longitude, 720.0)):
        if not (reach := float(np.abs(axis).max())) <= most:
            raise InputError(
                f"{where}: {name}s reach {reach:.6g} deg; are columns swapped, or is it a"
                " projected grid?"
            )
    rows, lat_axis = _axis(latitude, "latitude", where)
    column, lon_axis = _axis(longitude, "longitude", where)
    shape = lat_axis.size, lon_axis.size
    check_size(math.prod(shape), where)
    if math.prod(shape) > 50 * latitude.size + 1000:
        raise InputError(
            f"{where}: {latitude.size} points would fill under 2 % of a {shape[0]} x {shape[1]}"
            " grid; not a grid"
        )
    node = rows * lon_axis.size + column
    if np.unique(node).size != node.size:
        raise InputError(f"{where}: two points lie on the same node of the grid")
    grids = np.full((len(columns), math.prod(shape)), np.nan)
    grids[:, node] = columns
    return np.radians(lat_axis), np.radians(lon_axis), *grids.reshape(-1, *shape)


def _axis(coordinate: Array, name: str, where: str) -> tuple[Integers, Array]:
    """Return the index of each point along a regular axis, and the axis."""
    low, high = float(coordinate.min()), float(coordinate.max())
    steps = np.diff(np.unique(coordinate))
    # coordinates printed with few digits differ a little from row to row
    steps = steps[steps > 1e-7]
    nodes = round((high - low) / float(np.median(steps))) if steps.size else 0
    if not 3 <= nodes <= 10_000_000:
        raise InputError(f"{where}: {name} has {nodes + 1} nodes; at least 4 are needed")
    step = float((high - low) / nodes)
    index: Integers = np.rint((coordinate - low) / step).astype(np.int64)
    worst = float(np.abs(coordinate - low - index * step).max())
    if worst > 0.02 * step:
        raise InputError(
            f"{where}: the points do not lie on a regular grid: {name} is off by up to {worst:.3g}"
            f" of {step:.6g} deg"
        )
    return index, low + step * np.arange(nodes + 1, dtype=np.float64)


def numbers(lines: Iterable[str], columns: int, where: str, delimiter: str | None = None) -> Array:
    """Parse lines of numbers to (N, columns).

    Parameters
    ----------
    lines : iterable of str
        The rest of a file.
    columns : int
        Numbers in each line.
    where : str
        File, for messages.
    delimiter : str, optional
        Between numbers; None = blanks.

    Raises
    ------
    InputError
        Something is not a number, or lines differ in length; names the line where NumPy does.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without numbers
            table = np.loadtxt(
                lines, dtype=np.float64, delimiter=delimiter, ndmin=2, comments=("#", ">")
            )
    except (ValueError, UnicodeDecodeError, OverflowError) as error:
        reason = str(error).splitlines()[0].partition("; use")[0][:200]
        if cell := re.match(r"could not convert string (.*) to float64 at row (\d+)", reason):
            reason = (
                f"{cell[1]} in row {int(cell[2]) + 1} is no number"  # NumPy counts from 0 here
            )
        raise InputError(f"{where}: not a table of numbers, or cut short: {reason}") from None
    if not table.size:
        raise InputError(f"{where}: holds no numbers")
    if table.shape[1] != columns:
        raise InputError(f"{where}: has {table.shape[1]} columns of numbers, not {columns}")
    return table


def drop_gaps(values: Array, gap: float | None) -> Array:
    """Set the value that stands for "missing" to NaN, and what is infinite."""
    gap = math.nan if gap is None or math.isinf(gap) else gap
    missing = np.abs(values - gap) <= 1e-6 * max(abs(gap), 1e-3)
    return np.where(missing | ~np.isfinite(values), np.nan, values)
