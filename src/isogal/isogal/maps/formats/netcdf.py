"""Maps from NetCDF files of the CF and GMT (COARDS) conventions.

Latitude and longitude may come in any order and direction, in degrees or radians, 0 to 360 or -180
to 180; values packed or not. What the file does not say (quantity, unit) is asked for."""

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.assemble import assemble, check_size
from isogal.maps.axes import Part, RegularAxis, Window, part_within, regular_axis
from isogal.maps.error_ellipses import ELLIPSE_NAMES, ellipses_of
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Format, by_suffix
from isogal.maps.quantities import quantity_of, unit_factor

_LONGEST_AXIS = 5_000_000


def read_netcdf(
    path: str | Path,
    variable: str | None = None,
    window: Window | None = None,
    *,
    quantity: str | None = None,
    unit: str | None = None,
) -> FieldMap:
    """Read one variable of a NetCDF file as a map.

    Parameters
    ----------
    path : path
        File.
    variable : str, optional
        Which variable; None = the one whose quantity is ``quantity``, or the only one whose
        quantity is known.
    window : Window, optional
        Only this part is read, with the nodes around it that interpolation needs.
    quantity, unit : str, optional
        Where the file does not say, or says it wrong.

    Raises
    ------
    InputError
        Not a NetCDF file, no such variable, axes or unit or quantity not said, impossible numbers,
        broken data.
    """
    with open_netcdf(path) as dataset:
        return _read(dataset, variable, window, quantity, unit, str(path))


@contextmanager
def open_netcdf(path: str | Path) -> Iterator[Any]:
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
            _check_size(dataset, path)
            yield dataset


def _check_classic(path: Path) -> None:
    """Raise InputError where a file of the older classic formats is damaged or cut short, before
    the C library reads it: that trusts the counts in a header, which can cost minutes and
    gigabytes, and takes what is missing at the end for zeros."""
    from scipy.io import netcdf_file

    with path.open("rb") as file:
        if file.read(4) not in (b"CDF\x01", b"CDF\x02"):
            return
    damage: str | None = None
    # within, as a file that scipy gives up on warns when it is freed
    with warnings.catch_warnings(action="ignore"):
        try:
            netcdf_file(path, mmap=True).close()
        except (ValueError, LookupError, TypeError, ArithmeticError, MemoryError) as error:
            damage = str(error)
    if damage is not None:
        raise InputError(
            f"{path}: cannot be read as NetCDF: damaged header, or cut short? ({damage})"
        )


def _check_size(dataset: Any, path: Path) -> None:
    """Raise InputError where a file of the newest classic format (CDF-5), which scipy does not
    know, is smaller than its header and its numbers: what is missing would be read as zeros."""
    if dataset.data_model == "NETCDF3_64BIT_DATA":
        variables = dataset.variables.values()
        numbers = sum(item.size * item.dtype.itemsize for item in variables)
        needed = _header_size(dataset) + numbers
        if (size := path.stat().st_size) < needed:
            raise InputError(
                f"{path}: has {size} bytes, its header and numbers need {needed}; cut short?"
            )


def _header_size(dataset: Any) -> int:
    """Return the size of a CDF-5 file's header, bytes (NetCDF User's Guide, appendix B): a word is
    4 bytes, a count 8, and names and values end at a word."""

    def named(name: str) -> int:
        return 8 + _padded(len(name.encode()))

    def attributes(holder: Any) -> int:
        values = ((name, holder.getncattr(name)) for name in holder.ncattrs())
        return 12 + sum(named(name) + 12 + _padded(_bytes(value)) for name, value in values)

    dimensions = 12 + sum(named(name) + 8 for name in dataset.dimensions)
    variables = 12 + sum(
        named(name) + 8 + 8 * item.ndim + attributes(item) + 20
        for name, item in dataset.variables.items()
    )
    return 12 + dimensions + attributes(dataset) + variables


def _bytes(value: Any) -> int:
    return len(value.encode()) if isinstance(value, str) else int(np.asarray(value).nbytes)


def _padded(count: int) -> int:
    return -(-count // 4) * 4


def _read(
    dataset: Any,
    name: str | None,
    window: Window | None,
    quantity: str | None,
    unit: str | None,
    where: str,
) -> FieldMap:
    name = _choose(dataset, name, quantity, where)
    data = dataset.variables[name]
    where = f"{where}:{name}"
    grid = HorizontalGrid.of(dataset, data, where)
    part = part_within(*grid.regular, window, where)
    check_size(math.prod(part.shape), where, window)
    unit = unit or text_of(data, "units")
    attributes: dict[str, Any] = {
        "quantisation": number_of(data, "quantisation") or step_of(data),
        "correlation_length": number_of(data, "error_correlation_length") or None,
        "height": number_of(data, "height_m"),
    }
    stated = number_of(data, "error_stated")
    attributes["error_stated"] = None if stated is None else stated != 0.0
    sigma: Any = number_of(data, "error_sigma") or 0.0
    lengths = dataset.variables.get(f"{data.name}_error_length")
    if lengths is not None and set(lengths.dimensions) == set(data.dimensions):
        attributes["correlation_lengths"] = grid.read(lengths, part)
    axes = [dataset.variables.get(f"{data.name}_{name}") for name in ELLIPSE_NAMES]
    if all(axis is not None and set(axis.dimensions) == set(data.dimensions) for axis in axes):
        longest, shortest, azimuth = (grid.read(axis, part) for axis in axes)
        attributes["error_ellipses"] = ellipses_of(longest, shortest, np.radians(azimuth))
    beside = sigma_variable(dataset, data)
    if beside is not None:
        sigma = grid.read(beside, part)
        if unit is not None:
            own_factor = unit_factor(text_of(beside, "units") or unit, where)[1]
            sigma = sigma * (own_factor / unit_factor(unit, where)[1])
    return assemble(
        grid.latitude[part.rows],
        part.longitude(grid.regular[1].step),
        grid.read(data, part),
        unit=unit,
        quantity=quantity or quantity_in(data),
        where=where,
        sigma=sigma,
        **attributes,
    )


def _choose(dataset: Any, name: str | None, quantity: str | None, where: str) -> str:
    grids = [
        key
        for key, item in dataset.variables.items()
        if item.ndim >= 2 and np.dtype(item.dtype).kind in "iuf"
    ]
    if name is not None:
        if name not in dataset.variables:
            raise InputError(
                f"{where}: has no variable '{name}'; it has"
                f" {', '.join(dataset.variables) or 'none'}"
            )
        if name not in grids:
            raise InputError(
                f"{where}: variable '{name}' is not a grid of numbers; grids:"
                f" {', '.join(grids) or 'none'}"
            )
        return name
    known = {key: quantity_in(dataset.variables[key]) for key in grids}
    fitting = [key for key in grids if known[key] is not None and quantity in (None, known[key])]
    if len(fitting) == 1:
        return fitting[0]
    if not fitting and len(grids) == 1 and (quantity is None or known[grids[0]] is None):
        return grids[0]
    if not grids and "x_range" in dataset.variables:
        raise InputError(
            f"{where}: is a grid of GMT 3 (values in one dimension); convert it with 'gmt"
            " grdconvert' first"
        )
    asked = f"for {quantity}" if quantity else "to use"
    raise InputError(
        f"{where}: does not say which variable {asked}; give variable= (--variable) one of"
        f" {', '.join(grids) or '(it has no grid)'}"
    )


def quantity_in(data: Any) -> str | None:
    """Return what a variable is a map of, by what Isogal has written or by its names."""
    names = text_of(data, "standard_name"), data.name, text_of(data, "long_name")
    by_name = (found for text in names if text and (found := quantity_of(text)))
    return text_of(data, "isogal_quantity") or next(by_name, None)


def text_of(data: Any, attribute: str) -> str | None:
    """Return an attribute that is text; None where there is none."""
    text = getattr(data, attribute, None)
    return text.strip() or None if isinstance(text, str) else None


def number_of(data: Any, attribute: str) -> float | None:
    """Return an attribute that is a finite number; None where there is none."""
    value = getattr(data, attribute, None)
    return (
        float(value)
        if isinstance(value, int | float | np.number) and math.isfinite(value)
        else None
    )


def _kind(data: Any) -> str | None:
    """Tell whether a coordinate variable is latitude or longitude, by what CF and COARDS let it
    say."""
    units = (text_of(data, "units") or "").casefold()
    standard = (text_of(data, "standard_name") or "").casefold()
    for kind, directions in (
        ("latitude", ("north", "_n", "degreen")),
        ("longitude", ("east", "_e", "degreee")),
    ):
        if standard == kind or (
            units.startswith("degree") and units.rstrip("s").endswith(directions)
        ):
            return kind
    name = data.name.casefold()
    if name in ("lat", "latitude") or (text_of(data, "long_name") or "").casefold() == "latitude":
        return "latitude"
    if (
        name in ("lon", "long", "longitude")
        or (text_of(data, "long_name") or "").casefold() == "longitude"
    ):
        return "longitude"
    return None


def _horizontal(dataset: Any, data: Any, where: str) -> tuple[str, str]:
    """Return the dimensions of latitude and longitude; all others must have length one."""
    kinds: dict[str, str] = {}
    for dim in data.dimensions:
        axis = dataset.variables.get(dim)
        kind = _kind(axis) if axis is not None and axis.ndim == 1 else None
        if kind:
            kinds[kind] = dim
        elif len(dataset.dimensions[dim]) != 1:
            raise InputError(
                f"{where}: dimension '{dim}' is not said to be latitude or longitude (units"
                " degrees_north, degrees_east); a projected grid must come as GeoTIFF"
            )
    if len(kinds) != 2:
        raise InputError(
            f"{where}: needs one latitude and one longitude dimension, has"
            f" ({', '.join(data.dimensions)})"
        )
    return kinds["latitude"], kinds["longitude"]


def _axis(dataset: Any, name: str, kind: str, where: str) -> tuple[Array, bool]:
    """Return the axis in rad, increasing and exact, and whether it had to be turned round."""
    data = dataset.variables[name]
    if data.size > _LONGEST_AXIS:
        raise InputError(
            f"{where}: {name} has {data.size:,} nodes, at most {_LONGEST_AXIS:,} make sense"
        )
    axis = unpacked(data, data[:])
    units = (text_of(data, "units") or "").casefold()
    if units.startswith("deg") or (
        not units and axis.size and np.nanmax(np.abs(axis)) > 2.0 * math.pi
    ):
        axis = np.radians(axis)
    elif not units.startswith("rad"):
        raise InputError(f"{where}: {name} has the unit '{units}'; it must say degrees or radians")
    if kind == "longitude":  # a grid may pass 180 deg and go on at -180 deg
        axis = np.unwrap(axis)
    flipped = bool(axis.size > 1 and axis[-1] < axis[0])
    return regular_axis(axis[::-1] if flipped else axis, name, where), flipped


class HorizontalGrid(NamedTuple):
    """Latitude and longitude of a variable."""

    dimensions: tuple[str, str]
    """Names of latitude and longitude."""
    latitude: Array
    """rad, increasing and exact."""
    longitude: Array
    """rad, increasing and exact."""
    flipped: tuple[bool, bool]
    """Whether the file has them the other way round."""

    @classmethod
    def of(cls, dataset: Any, data: Any, where: str) -> "HorizontalGrid":
        """Read the axes of a variable.

        Raises
        ------
        InputError
            There are none, they are not regular, or do not say what they are.
        """
        dimensions = _horizontal(dataset, data, where)
        latitude, up = _axis(dataset, dimensions[0], "latitude", where)
        longitude, right = _axis(dataset, dimensions[1], "longitude", where)
        if np.abs(latitude).max() > math.pi / 2 + 1e-9:
            raise InputError(
                f"{where}: latitudes reach {math.degrees(np.abs(latitude).max()):.6g} deg; axes"
                " swapped, or not degrees?"
            )
        return cls(dimensions, latitude, longitude, (up, right))

    @property
    def regular(self) -> tuple[RegularAxis, RegularAxis]:
        """First node, step and number of nodes of both axes."""
        latitude, longitude = (
            RegularAxis(axis[0], (axis[-1] - axis[0]) / (axis.size - 1), axis.size)
            for axis in (self.latitude, self.longitude)
        )
        return latitude, longitude

    def read(self, data: Any, part: Part) -> NDArray[Any]:
        """Return a part of a variable on this grid as (latitude, longitude), unpacked."""
        blocks = [self._block(data, part.rows, columns) for columns in part.columns]
        return blocks[0] if len(blocks) == 1 else np.concatenate(blocks, axis=1)

    def _block(self, data: Any, rows: slice, columns: slice) -> NDArray[Any]:
        stored = [
            slice(axis.size - part.stop, axis.size - part.start) if flipped else part
            for axis, part, flipped in zip(
                (self.latitude, self.longitude), (rows, columns), self.flipped, strict=True
            )
        ]
        where = dict(zip(self.dimensions, stored, strict=True))
        raw = data[tuple(where.get(dimension, 0) for dimension in data.dimensions)]
        values = unpacked(data, raw)
        latitude, longitude = self.dimensions
        if data.dimensions.index(latitude) > data.dimensions.index(longitude):
            values = values.T
        return values[:: -1 if self.flipped[0] else 1, :: -1 if self.flipped[1] else 1]


def unpacked(data: Any, raw: NDArray[Any]) -> NDArray[Any]:
    """Apply scale and offset (CF 8.1) to values whose missing ones netCDF4 has masked, and make
    those NaN; float32 stays float32, all else becomes float64."""
    scale = float(getattr(data, "scale_factor", 1.0))
    offset = float(getattr(data, "add_offset", 0.0))
    packed = scale != 1.0 or offset != 0.0
    kind = np.float32 if raw.dtype == np.float32 and not packed else np.float64
    values: NDArray[Any] = np.ma.filled(raw.astype(kind), np.nan)
    if packed:
        values *= scale
        values += offset
    return values


def step_of(data: Any) -> float:
    """Return the step of values packed as whole numbers."""
    return (
        abs(float(getattr(data, "scale_factor", 1.0)))
        if np.dtype(data.dtype).kind in "iu"
        else 0.0
    )


def sigma_variable(dataset: Any, data: Any) -> Any:
    """Return the variable that holds the 1-sigma of ``data``, if the file has one."""
    named = (text_of(data, "ancillary_variables") or "").split()
    names = [
        n
        for n in named
        if "standard_error" in (text_of(dataset.variables.get(n), "standard_name") or "")
    ]
    for name in (*names, f"{data.name}_sigma", "map_sigma"):
        beside = dataset.variables.get(name)
        if (
            beside is not None
            and name != data.name
            and set(data.dimensions) == set(beside.dimensions)
        ):
            return beside
    return None


FORMAT = Format("netcdf", by_suffix(".nc", ".nc4", ".grd", ".cdf"), read_netcdf)
