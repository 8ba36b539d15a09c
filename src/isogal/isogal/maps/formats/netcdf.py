"""Maps from NetCDF files of the CF and GMT (COARDS) conventions.

Latitude and longitude may come in any order and direction, in degrees or radians, 0 to 360 or -180
to 180; values packed or not. What the file does not say (quantity, unit) is asked for."""

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isogal.arrays import Array, Values
from isogal.errors import InputError
from isogal.files import reading, unreadable
from isogal.maps.axes import Read, regular_axis
from isogal.maps.error_ellipses import ELLIPSE_NAMES, ellipses_of
from isogal.maps.formats.format import Asked, FileGrid, file_format
from isogal.maps.quantities import quantity_of

if TYPE_CHECKING:
    from netCDF4 import Dataset
    from netCDF4 import Variable as AnyVariable

    Variable = AnyVariable[np.generic]

_LONGEST_AXIS = 5_000_000
_SAYS = {
    "latitude": (("lat", "latitude"), ("north", "_n", "degreen")),
    "longitude": (("lon", "long", "longitude"), ("east", "_e", "degreee")),
}
"""By what an axis says that it is latitude or longitude: names, and ends of its unit."""


@contextmanager
def _open(path: Path, asked: Asked) -> Iterator[FileGrid]:
    """Open a file and find the variable that is asked for: the one of that name, else the one of
    that quantity, else the only one whose quantity is known."""
    with open_netcdf(path) as dataset:
        data = dataset.variables[_choose(dataset, asked.variable, asked.quantity, str(path))]
        where = f"{path}:{data.name}"
        latitude, longitude = _axes(dataset, data, where)

        read = {
            name: partial(_values, other, latitude, longitude)
            for name, other in dataset.variables.items()
            if set(other.dimensions) == set(data.dimensions)
        }
        sigma = _sigma_of(dataset, data, [name for name in read if name != data.name])
        ellipse = [read[of] for name in ELLIPSE_NAMES if (of := f"{data.name}_{name}") in read]
        if len(ellipse) < 3:
            ellipse = [read[of] for of in (f"{data.name}_error_length",) if of in read]
        stated = number_of(data, "error_stated")
        packed = np.dtype(data.dtype).kind in "iu"
        step = abs(float(getattr(data, "scale_factor", 1.0))) if packed else 0.0
        yield FileGrid(
            where=where,
            latitude=latitude.nodes,
            longitude=longitude.nodes,
            values=read[data.name],
            unit=text_of(data, "units"),
            quantity=quantity_in(data),
            quantisation=number_of(data, "quantisation") or step,
            sigma=read[sigma] if sigma else number_of(data, "error_sigma") or 0.0,
            sigma_unit=text_of(dataset.variables[sigma], "units") if sigma else None,
            correlation_length=number_of(data, "error_correlation_length") or None,
            error_ellipses=partial(_ellipses, ellipse) if len(ellipse) in (1, 3) else None,
            error_stated=None if stated is None else stated != 0.0,
            unresolved=number_of(data, "error_unresolved") or 0.0,
            height=number_of(data, "height_m"),
        )


@contextmanager
def open_netcdf(path: str | Path) -> Iterator["Dataset"]:
    """Open a file as netCDF4 does, but with values packed as they are (`unpacked`); whatever goes
    wrong with it in the block raises InputError."""
    import netCDF4

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    with reading(path, "NetCDF"):
        _check_classic(path)
        with netCDF4.Dataset(str(path)) as dataset:
            dataset.set_auto_scale(False)
            if dataset.data_model == "NETCDF3_64BIT_DATA":  # cut short, the rest is read as zeros
                raise InputError(
                    f"{path}: is of the classic format CDF-5; convert it with 'nccopy -k nc4'"
                )
            yield dataset


def _check_classic(path: Path) -> None:
    """Raise InputError where a file of the older classic formats is damaged or cut short, before
    the C library reads it: that trusts the counts in a header, which can cost minutes and
    gigabytes, and takes what is missing at the end for zeros."""
    from scipy.io import netcdf_file

    with path.open("rb") as file:
        if file.read(4) not in (b"CDF\x01", b"CDF\x02"):
            return
    damaged = False
    # within, as a file that scipy gives up on warns when it is freed
    with warnings.catch_warnings(action="ignore"):
        try:
            netcdf_file(path, mmap=True).close()
        except (ValueError, LookupError, TypeError, ArithmeticError, MemoryError):
            damaged = True
    if damaged:
        raise unreadable(path, "NetCDF")


def _choose(dataset: "Dataset", name: str | None, quantity: str | None, where: str) -> str:
    known = {
        key: quantity_in(item)
        for key, item in dataset.variables.items()
        if item.ndim >= 2 and np.dtype(item.dtype).kind in "iuf"
    }
    each = ", ".join(f"{key} ({found or 'of nothing said'})" for key, found in known.items())
    if name is not None:
        if name not in known:
            raise InputError(f"{where}: has no grid '{name}'; it has {each or 'none'}")
        return name
    fitting = [key for key, found in known.items() if found and quantity in (None, found)]
    if len(fitting) == 1:
        return fitting[0]
    if len(known) == 1 and (quantity is None or None in known.values()):
        return next(iter(known))
    asked = f"for {quantity}" if quantity else "to use"
    raise InputError(
        f"{where}: does not say which variable {asked}; give variable= (--variable, map.variable)"
        f" one of {each or '(it has no grid of two dimensions)'}"
    )


def quantity_in(data: "Variable") -> str | None:
    """Return what a variable is a map of, by what Isogal has written or by its names."""
    names = text_of(data, "standard_name"), data.name, text_of(data, "long_name")
    by_name = (found for text in names if text and (found := quantity_of(text)))
    return text_of(data, "isogal_quantity") or next(by_name, None)


def text_of(data: "Variable", attribute: str) -> str | None:
    """Return an attribute that is text; None where there is none."""
    text = getattr(data, attribute, None)
    return text.strip() or None if isinstance(text, str) else None


def number_of(data: "Variable", attribute: str) -> float | None:
    """Return an attribute that is a finite number; None where there is none."""
    value = getattr(data, attribute, None)
    if isinstance(value, int | float | np.number) and math.isfinite(value):
        return float(value)
    return None


class _Axis(NamedTuple):
    """Latitude or longitude of a variable."""

    dimension: str
    nodes: Array
    """rad, increasing and exact."""
    flipped: bool
    """Whether the file has them the other way round."""

    def stored(self, part: slice) -> slice:
        """Return where the file has some of the nodes."""
        count = self.nodes.size
        return slice(count - part.stop, count - part.start) if self.flipped else part


def _kind(axis: "Variable") -> str | None:
    """Tell whether a coordinate variable is latitude or longitude, by what CF and COARDS let it
    say; unit and standard name before the name."""
    units, standard, long = (
        (text_of(axis, name) or "").casefold() for name in ("units", "standard_name", "long_name")
    )
    for kind, (_, ends) in _SAYS.items():
        degrees = units.startswith("degree") and units.rstrip("s").endswith(ends)
        if standard == kind or degrees:
            return kind
    by_name = (k for k, (names, _) in _SAYS.items() if axis.name.casefold() in names or long == k)
    return next(by_name, None)


def _axes(dataset: "Dataset", data: "Variable", where: str) -> tuple[_Axis, _Axis]:
    """Return latitude and longitude of a variable, all of whose other dimensions must have length
    one.

    Raises
    ------
    InputError
        There are none, they are not regular, or do not say what they are.
    """
    found: dict[str, Variable] = {}
    for dimension in data.dimensions:
        axis = dataset.variables.get(dimension)
        kind = _kind(axis) if axis is not None and axis.ndim == 1 else None
        if axis is not None and kind:
            found[kind] = axis
        elif (count := len(dataset.dimensions[dimension])) != 1 and len(data.dimensions) > 2:
            raise InputError(
                f"{where}: has {count} values along '{dimension}' at each place, where a map has"
                " one: write one of them to a file of its own"
            )
        elif count != 1:
            raise InputError(
                f"{where}: dimension '{dimension}' is not said to be latitude or longitude (units"
                " degrees_north, degrees_east); a projected grid must come as GeoTIFF"
            )
    if len(found) != 2:
        raise InputError(
            f"{where}: needs one latitude and one longitude dimension, has"
            f" ({', '.join(data.dimensions)})"
        )
    return _axis(found["latitude"], where), _axis(found["longitude"], where, turns=True)


def _axis(data: "Variable", where: str, turns: bool = False) -> _Axis:
    """Return an axis; `turns`: it may pass 180 deg and go on at -180 deg."""
    if data.size > _LONGEST_AXIS:
        raise InputError(f"{where}: {data.name} has {data.size:,} nodes, which makes no sense")
    nodes = unpacked(data, data[:])
    units = (text_of(data, "units") or "").casefold()
    if units.startswith("deg") or (
        not units and nodes.size and np.nanmax(np.abs(nodes)) > 2.0 * math.pi
    ):
        nodes = np.radians(nodes)
    elif not units.startswith("rad"):
        raise InputError(
            f"{where}: {data.name} has the unit '{units}'; it must say degrees or radians"
        )
    nodes = np.unwrap(nodes) if turns else nodes
    flipped = bool(nodes.size > 1 and nodes[-1] < nodes[0])
    exact = regular_axis(nodes[::-1] if flipped else nodes, data.name, where)
    return _Axis(data.name, exact, flipped)


def _values(
    data: "Variable", latitude: _Axis, longitude: _Axis, rows: slice, columns: slice
) -> Values:
    """Return a part of a variable as (latitude, longitude), both increasing, unpacked.

    Parameters
    ----------
    data : Variable
        Of these axes; further dimensions have length one.
    latitude, longitude : _Axis
    rows, columns : slice
        Which nodes of the axes.
    """
    stored = {
        latitude.dimension: latitude.stored(rows),
        longitude.dimension: longitude.stored(columns),
    }
    values = unpacked(data, data[tuple(stored.get(name, 0) for name in data.dimensions)])
    if data.dimensions.index(latitude.dimension) > data.dimensions.index(longitude.dimension):
        values = values.T
    return values[:: -1 if latitude.flipped else 1, :: -1 if longitude.flipped else 1]


def _ellipses(reads: Sequence[Read], rows: slice, columns: slice) -> Array:
    """Return those of lengths and azimuth, or of one length in all directions."""
    longest, *more = (read(rows, columns) for read in reads)
    shortest, azimuth = more or (longest, np.zeros_like(longest))
    return ellipses_of(longest, shortest, np.radians(azimuth))


def unpacked(
    data: "Variable", raw: "np.ma.MaskedArray[tuple[int, ...], np.dtype[np.generic]]"
) -> Values:
    """Apply scale and offset (CF 8.1) to values whose missing ones netCDF4 has masked, and make
    those NaN; all becomes float64, for which kernels are compiled."""
    scale = float(getattr(data, "scale_factor", 1.0))
    offset = float(getattr(data, "add_offset", 0.0))
    values: Array = np.ma.filled(raw.astype(np.float64), np.nan)
    values *= scale  # in place: grids may be large
    values += offset
    return values


def _sigma_of(dataset: "Dataset", data: "Variable", others: list[str]) -> str | None:
    """Return which of other variables on the grid holds the 1-sigma of ``data``, if one does."""
    said = {name: text_of(dataset.variables[name], "standard_name") or "" for name in others}
    named = (text_of(data, "ancillary_variables") or "").split()
    names = [name for name in named if "standard_error" in said.get(name, "")]
    names += [f"{data.name}_sigma", "map_sigma"]
    return next((name for name in names if name in others), None)


FORMAT = file_format("netcdf", (".nc", ".nc4", ".grd", ".cdf"), _open)
