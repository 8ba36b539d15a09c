"""Single variables of a NetCDF file: what they say about themselves, and their numbers."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.axes import Part, RegularAxis, regular_axis
from isogal.maps.quantities import quantity_of

_LONGEST_AXIS = 5_000_000


def quantity_in(data: Any) -> str | None:
    """Return what a variable is a map of, by its names."""
    for text in (text_of(data, "standard_name"), data.name, text_of(data, "long_name")):
        if text and (found := quantity_of(text)):
            return found
    return None


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
    axis = _unpacked(data, data[:])
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
        values = _unpacked(data, np.asarray(raw))
        latitude, longitude = self.dimensions
        if data.dimensions.index(latitude) > data.dimensions.index(longitude):
            values = values.T
        return values[:: -1 if self.flipped[0] else 1, :: -1 if self.flipped[1] else 1]


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
