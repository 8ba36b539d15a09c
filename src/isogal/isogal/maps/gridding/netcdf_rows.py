"""Rows of a NetCDF file whose variables have one dimension, as those of a table of text."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.formats.netcdf import open_netcdf, text_of, unpacked
from isogal.maps.gridding.text_rows import TIME, Column, TextRows, read_rows

SUFFIXES = (".nc", ".nc4", ".cdf")
_SECONDS = {"second": 1.0, "minute": 60.0, "hour": 3600.0, "day": 86400.0}
"""In a unit of time, as CF-conventions name it in the singular."""


@dataclass(frozen=True, slots=True)
class NetcdfRows(TextRows):
    """Variables (all rows of the file, by `number` from 1), each with its unit."""

    values: dict[str, Array]
    """By name in lower case; NaN = missing."""
    units: dict[str, str]

    def _numbers(self, i: int, name: str, column: Column) -> Array:
        """Return the numbers (N,) of the variable that is the i-th, times in s since 1970."""
        own = self.names[i]
        found = self.values[own][np.array(self.number) - 1]
        if column is TIME:
            found = _seconds(found, self.units.get(own, ""), f"{self.where}: {own}")
        bad = ~np.isfinite(found) & ~(column.gaps & np.isnan(found))
        bad |= (found < column.least) | (found > column.most)
        if bad.any():
            first = int(np.argmax(bad))
            limits = f"{column.least:g} to {column.most:g}{column.unit}, "
            raise InputError(
                f"{self.where}: {name} of row {self.number[first]} is {found[first]:g}, must be"
                f" {limits if np.isfinite(column.most) else ''}finite"
            )
        return found


def _seconds(time: Array, unit: str, where: str) -> Array:
    """Return times in s: since 1970 where the unit says since when."""
    scale, _, since = unit.partition(" since ")
    factor = _SECONDS.get(scale.strip().removesuffix("s"), 1.0 if scale in ("", "s") else None)
    try:
        start = datetime.fromisoformat(since.strip()) if since else None
    except ValueError:
        factor = start = None
    if factor is None:
        raise InputError(
            f"{where}: unknown unit '{unit}'; must be seconds, minutes, hours or days, or so many"
            " since a date and time by ISO 8601"
        )
    if start is None:
        return time * factor
    whole = start if start.tzinfo else start.replace(tzinfo=UTC)
    return np.asarray(time * factor + whole.timestamp())


def rows_of(path: str | Path, needed: str) -> TextRows:
    """Read a table of text (`read_rows`), or a NetCDF file by its suffix.

    Raises
    ------
    InputError
        It cannot be read, or has none of the columns `needed` in its header.
    """
    if Path(path).suffix.casefold() not in SUFFIXES:
        return read_rows(path, needed)
    with open_netcdf(path) as dataset:
        flat = {
            name.casefold(): data
            for name, data in dataset.variables.items()
            if data.ndim == 1 and np.dtype(data.dtype).kind in "iuf"
        }
        sizes = {name: data.shape[0] for name, data in flat.items()}
        count = sizes.get("time", max(sizes.values(), default=0))
        flat = {name: data for name, data in flat.items() if sizes[name] == count}
        values = {name: unpacked(data, data[:]).astype(np.float64) for name, data in flat.items()}
        units = {name: text_of(data, "units") or "" for name, data in flat.items()}
    line = None
    if "line" in values:
        line = [f"{number:g}" if number % 1 else f"{number:.0f}" for number in values["line"]]
    numbers = list(range(1, count + 1))
    return NetcdfRows(list(values), [], numbers, line, str(path), values, units)
