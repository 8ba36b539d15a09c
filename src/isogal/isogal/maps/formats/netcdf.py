"""NetCDF maps: CF and GMT (COARDS) conventions in, CF out.

Latitude and longitude may come in any order and direction, in degrees or radians, 0 to 360 or -180
to 180; values packed or not. What the file does not say (quantity, unit) is asked for."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import atomic_path
from isogal.maps.assemble import assemble, check_size
from isogal.maps.axes import (
    EmptyWindowError,
    Window,
    latitude_slice,
    longitude_slices,
    regular_axis,
)
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Format, by_suffix
from isogal.maps.formats.netcdf_classic import check_classic
from isogal.maps.quantities import quantity_of, unit_factor

_CF_UNITS = {"m/s²": "m s-2", "1/s²": "s-2"}
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
    import netCDF4

    where = str(path)
    if not Path(path).is_file():
        raise InputError(f"{where}: no such file")
    try:
        check_classic(Path(path), where)
        with netCDF4.Dataset(str(path)) as dataset:
            dataset.set_auto_maskandscale(False)
            return _read(dataset, variable, window, quantity, unit, where)
    except InputError:
        raise
    except (
        OSError,
        RuntimeError,
        ValueError,
        KeyError,
        IndexError,
        AttributeError,
        TypeError,
        MemoryError,
    ) as error:
        raise InputError(
            f"{where}: cannot be read as NetCDF:"
            f" {str(error).splitlines()[0] if str(error) else error!r}"
        ) from None


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
    dims = _horizontal(dataset, data, where)
    lat, lat_flipped = _axis(dataset, dims[0], "latitude", where)
    lon, lon_flipped = _axis(dataset, dims[1], "longitude", where)
    if np.abs(lat).max() > math.pi / 2 + 1e-9:
        raise InputError(
            f"{where}: latitudes reach {math.degrees(np.abs(lat).max()):.6g} deg; axes swapped, or"
            " not degrees?"
        )
    rows, columns, first = slice(0, lat.size), [slice(0, lon.size)], lon[0]
    dlon = (lon[-1] - lon[0]) / (lon.size - 1)
    if window is not None:
        rows = latitude_slice(
            lat[0], (lat[-1] - lat[0]) / (lat.size - 1), lat.size, window.south, window.north
        )
        columns, first = longitude_slices(lon[0], dlon, lon.size, window.west, window.east)
    count = sum(part.stop - part.start for part in columns)
    if rows.stop - rows.start < 4 or count < 4:
        extent = Window(lat[0], lat[-1], lon[0], lon[-1]).text()
        raise EmptyWindowError(
            f"{where}: the map ({extent}) has nothing at {window.text() if window else extent}"
        )
    check_size((rows.stop - rows.start) * count, where, window)

    def cut(source: Any) -> Any:
        parts = [
            _block(source, dims, rows, part, (lat.size, lat_flipped), (lon.size, lon_flipped))
            for part in columns
        ]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    said = quantity or _text(data, "isogal_quantity") or _quantity(data)
    unit = unit or _text(data, "units")
    attributes: dict[str, Any] = {"quantisation": _number(data, "quantisation") or _step(data)}
    if length := _number(data, "error_correlation_length"):
        attributes["correlation_length"] = length
    attributes["height"] = _number(data, "height_m")
    sigma: Any = _number(data, "error_sigma") or 0.0
    beside = _sigma_variable(dataset, data)
    if beside is not None:
        sigma = cut(beside)
        if unit is not None:
            sigma = sigma * (
                unit_factor(_text(beside, "units") or unit, where)[1] / unit_factor(unit, where)[1]
            )
    return assemble(
        lat[rows],
        first + dlon * np.arange(count),
        cut(data),
        unit=unit,
        quantity=said,
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
    known = {
        key: _text(dataset.variables[key], "isogal_quantity") or _quantity(dataset.variables[key])
        for key in grids
    }
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


def _quantity(data: Any) -> str | None:
    for text in (_text(data, "standard_name"), data.name, _text(data, "long_name")):
        if text and (found := quantity_of(text)):
            return found
    return None


def _text(data: Any, attribute: str) -> str | None:
    text = getattr(data, attribute, None)
    return text.strip() or None if isinstance(text, str) else None


def _number(data: Any, attribute: str) -> float | None:
    value = getattr(data, attribute, None)
    return (
        float(value)
        if isinstance(value, int | float | np.number) and math.isfinite(value)
        else None
    )


def _kind(data: Any) -> str | None:
    """Tell whether a coordinate variable is latitude or longitude, by what CF and COARDS let it
    say."""
    units = (_text(data, "units") or "").casefold()
    standard = (_text(data, "standard_name") or "").casefold()
    for kind, directions in (
        ("latitude", ("north", "_n", "degreen")),
        ("longitude", ("east", "_e", "degreee")),
    ):
        if standard == kind or (
            units.startswith("degree") and units.rstrip("s").endswith(directions)
        ):
            return kind
    name = data.name.casefold()
    if name in ("lat", "latitude") or (_text(data, "long_name") or "").casefold() == "latitude":
        return "latitude"
    if (
        name in ("lon", "long", "longitude")
        or (_text(data, "long_name") or "").casefold() == "longitude"
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
    axis = _unpacked(data, data[:])
    units = (_text(data, "units") or "").casefold()
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


def _block(
    data: Any,
    dims: tuple[str, str],
    rows: slice,
    columns: slice,
    lat: tuple[int, bool],
    lon: tuple[int, bool],
) -> NDArray[Any]:
    """Read rows and columns (of the increasing axes) as (latitude, longitude), unpacked."""

    def stored(part: slice, size: int, flipped: bool) -> slice:
        return slice(size - part.stop, size - part.start) if flipped else part

    where = {dims[0]: stored(rows, *lat), dims[1]: stored(columns, *lon)}
    raw = data[tuple(where.get(dim, 0) for dim in data.dimensions)]
    values = _unpacked(data, np.asarray(raw))
    if data.dimensions.index(dims[0]) > data.dimensions.index(dims[1]):
        values = values.T
    return values[:: -1 if lat[1] else 1, :: -1 if lon[1] else 1]


def _unpacked(data: Any, raw: NDArray[Any]) -> NDArray[Any]:
    """Apply missing values, valid range, scale and offset (CF 8.1); float32 stays float32, all
    else becomes float64."""
    import netCDF4

    raw = np.asarray(raw)
    missing = np.zeros(raw.shape, dtype=bool)
    fills = [getattr(data, key) for key in ("_FillValue", "missing_value") if hasattr(data, key)]
    if not fills and raw.dtype.itemsize > 1:
        fills = [netCDF4.default_fillvals[raw.dtype.str[1:]]]
    for fill in fills:
        for value in np.atleast_1d(fill):
            missing |= raw == value
    low, high = getattr(
        data, "valid_range", (getattr(data, "valid_min", None), getattr(data, "valid_max", None))
    )
    if low is not None:
        missing |= raw < low
    if high is not None:
        missing |= raw > high
    scale, offset = (
        float(getattr(data, "scale_factor", 1.0)),
        float(getattr(data, "add_offset", 0.0)),
    )
    packed = scale != 1.0 or offset != 0.0
    values: NDArray[Any] = raw.astype(
        np.float32 if raw.dtype == np.float32 and not packed else np.float64
    )
    if packed:
        values *= scale
        values += offset
    values[missing] = np.nan
    return values


def _step(data: Any) -> float:
    """Return the step of values packed as whole numbers."""
    return (
        abs(float(getattr(data, "scale_factor", 1.0)))
        if np.dtype(data.dtype).kind in "iu"
        else 0.0
    )


def _sigma_variable(dataset: Any, data: Any) -> Any:
    """Return the variable that holds the 1-sigma of ``data``, if the file has one."""
    named = (_text(data, "ancillary_variables") or "").split()
    names = [
        n
        for n in named
        if "standard_error" in (_text(dataset.variables.get(n), "standard_name") or "")
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


def write_netcdf(field_map: FieldMap, path: str | Path, variable: str | None = None) -> None:
    """Write a map as CF-1.8 NetCDF, such that `read_netcdf` gives the same map back.

    Parameters
    ----------
    field_map : FieldMap
        The map.
    path : path
        File; appears only when complete.
    variable : str, optional
        Name of the variable; None = the quantity.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    try:
        with atomic_path(path) as temporary:
            _write(field_map, temporary, variable or field_map.quantity)
    except RuntimeError as error:  # what the C library raises, for example where the disk is full
        raise InputError(f"{path}: cannot be written: {error}") from None


def _write(field_map: FieldMap, path: Path, name: str) -> None:
    import netCDF4

    unit = _CF_UNITS.get(field_map.unit, field_map.unit)
    with netCDF4.Dataset(str(path), "w") as dataset:
        dataset.Conventions = "CF-1.8"
        dataset.title = f"{field_map.quantity} map"
        dataset.source = field_map.provenance
        for key, axis, text in (
            ("lat", field_map.latitude, "latitude"),
            ("lon", field_map.longitude, "longitude"),
        ):
            dataset.createDimension(key, axis.size)
            coordinate = dataset.createVariable(key, "f8", (key,))
            coordinate.standard_name = coordinate.long_name = text
            coordinate.units = "degrees_north" if key == "lat" else "degrees_east"
            coordinate[:] = np.degrees(axis)
        kwargs: dict[str, Any] = {
            "zlib": True,
            "complevel": 4,
            "fletcher32": True,
            "fill_value": np.nan,
        }
        data = dataset.createVariable(
            name, field_map.values.dtype.str[1:], ("lat", "lon"), **kwargs
        )
        data.units = unit
        data.long_name = field_map.quantity.replace("_", " ")
        data.isogal_quantity = field_map.quantity
        if field_map.quantisation:
            data.quantisation = field_map.quantisation
        if field_map.correlation_length is not None:
            data.error_correlation_length = field_map.correlation_length
        if field_map.height is not None:
            data.height_m = field_map.height
        data[:] = field_map.values
        if isinstance(field_map.sigma, float):
            data.error_sigma = field_map.sigma
        else:
            data.ancillary_variables = f"{name}_sigma"
            sigma = dataset.createVariable(f"{name}_sigma", "f8", ("lat", "lon"), **kwargs)
            sigma.units = unit
            sigma.long_name = f"1-sigma error of {name}"
            sigma[:] = field_map.sigma


FORMAT = Format("netcdf", by_suffix(".nc", ".nc4", ".grd", ".cdf"), read_netcdf)
