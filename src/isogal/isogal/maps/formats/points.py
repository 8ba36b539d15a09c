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
    latitude: Array, longitude: Array, value: Array, where: str
) -> tuple[Array, Array, Array]:
    """Arrange points that lie on a regular grid, in any order; nodes without a point are NaN.

    Parameters
    ----------
    latitude, longitude : (N,) deg
    value : (N,)
    where : str
        File, for messages.

    Returns
    -------
    latitude (n,), longitude (m,) in rad, increasing, and values (n, m)

    Raises
    ------
    InputError
        Points off a regular grid, the same node twice, latitudes that are none.
    """
    if not latitude.size:
        raise InputError(f"{where}: has no points")
    if not (np.isfinite(latitude).all() and np.isfinite(longitude).all()):
        raise InputError(f"{where}: a point has no coordinates")
    if np.abs(latitude).max() > 90.0:
        raise InputError(
            f"{where}: latitudes reach {np.abs(latitude).max():.6g} deg; are the columns swapped?"
        )
    if np.abs(longitude).max() > 720.0:
        raise InputError(
            f"{where}: longitudes reach {np.abs(longitude).max():.6g} deg; is it a projected grid?"
        )
    rows, lat_axis = _axis(latitude, "latitude", where)
    columns, lon_axis = _axis(longitude, "longitude", where)
    check_size(lat_axis.size * lon_axis.size, where)
    if lat_axis.size * lon_axis.size > 50 * value.size + 1000:
        raise InputError(
            f"{where}: {value.size} points would fill under 2 % of a {lat_axis.size} x"
            f" {lon_axis.size} grid; not a grid"
        )
    node = rows * lon_axis.size + columns
    if np.unique(node).size != node.size:
        raise InputError(f"{where}: two points lie on the same node of the grid")
    values = np.full(lat_axis.size * lon_axis.size, np.nan)
    values[node] = value
    return np.radians(lat_axis), np.radians(lon_axis), values.reshape(lat_axis.size, lon_axis.size)


def _axis(coordinate: Array, name: str, where: str) -> tuple[Integers, Array]:
    """Return the index of each point along a regular axis, and the axis."""
    low, high = float(coordinate.min()), float(coordinate.max())
    steps = np.diff(np.unique(coordinate))
    steps = steps[
        steps > 1e-7
    ]  # coordinates printed with few digits differ a little from row to row
    if not steps.size:
        raise InputError(f"{where}: all points have the same {name}")
    nodes = round((high - low) / float(np.median(steps)))
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
    axis: Array = low + step * np.arange(nodes + 1, dtype=np.float64)
    return index, axis


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
    """Set the value that stands for "missing" to NaN."""
    if gap is not None and math.isfinite(gap):
        values = np.where(np.abs(values - gap) <= 1e-6 * max(abs(gap), 1e-3), np.nan, values)
    return np.where(np.isfinite(values), values, np.nan)
