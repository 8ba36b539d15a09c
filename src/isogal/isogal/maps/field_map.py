"""A map in memory: a scalar field on a regular grid of latitude and longitude, with what is known
about its errors."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array, Booleans, Values, real_numbers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.axes import (
    EmptyWindowError,
    Window,
    part_within,
    regular_axis,
)
from isogal.maps.error_ellipses import impossible
from isogal.maps.interpolation import (
    Grid,
    bilinear_at,
    is_periodic,
    values_and_gradients,
    values_at,
)

_ERRORS_AT_NODES = ("sigma", "error_ellipses")
"""Attributes that may hold an array over the nodes."""


@dataclass(frozen=True, eq=False)
class FieldMap:
    """A scalar field on a regular grid of the GRS80 ellipsoid.

    Parameters
    ----------
    latitude : (n,) rad
        Increasing, regular, at least four nodes.
    longitude : (m,) rad
        Increasing, regular, at least four nodes; a grid round the Earth has each meridian once.
    values : (n, m) float64 or float32
        At the nodes; NaN or masked = missing. Gravity (9.8 m/s²) needs float64: float32 rounds it
        to 0.1 mGal.
    unit : str
        SI, except magnetic fields, which are in nT throughout.
    quantity : str
        See `isogal.maps.quantities`.
    sigma : float or (n, m)
        1-sigma of the map's error, in `unit`; 0 = taken as exact.
    correlation_length : float or None
        Of that error, m; None = unknown.
    error_ellipses : (n, m, 3) or None
        The same at each node, where it differs from place to place and from direction to
        direction, m² (`isogal.maps.error_ellipses`); NaN = not known there. `correlation_length`
        is then the usual one.
    error_stated : bool or None
        Whether `sigma` is said of the map's whole error; False = it is only what processing has
        added to an error that was never stated; None = where it is above 0.
    unresolved : float
        Part of `sigma`, 1-sigma in `unit`, that differs from one reading to the next, or from one
        line of readings to another: correlation and ellipses are of the rest; 0 = none.
    quantisation : float
        Step of the values, in `unit` (its error has 1-sigma step / sqrt(12)); 0 = none.
    provenance : str
        Where it comes from, one line.
    file_unit : str
        Unit that the file was in; `file_factor` times a number in it is a number in `unit`.
    file_factor : float
        See `file_unit`.
    height : float or None
        Of the level that the values hold on, m above the ellipsoid; None = not said, or not a
        level, such as the ground.

    Raises
    ------
    InputError
        Axes that are not regular, shapes that do not fit, no value at all, negative sigma,
        infinite height.
    """

    latitude: Array
    longitude: Array
    values: Values
    unit: str
    quantity: str
    sigma: float | Array = 0.0
    correlation_length: float | None = None
    quantisation: float = 0.0
    provenance: str = ""
    file_unit: str = ""
    file_factor: float = 1.0
    height: float | None = None
    error_stated: bool | None = None
    error_ellipses: Array | None = None
    unresolved: float = 0.0

    def __post_init__(self) -> None:
        where = self.provenance or f"{self.quantity} map"
        latitude = regular_axis(self.latitude, "latitude", where)
        longitude = regular_axis(self.longitude, "longitude", where)
        if latitude[0] < -math.pi / 2 - 1e-9 or latitude[-1] > math.pi / 2 + 1e-9:
            raise InputError(
                f"{where}: latitudes must lie within -90 to 90 deg; are they in degrees, or"
                " swapped with longitude?"
            )
        values = real_numbers(self.values, f"{where}: values")
        if values.shape != (latitude.size, longitude.size):
            raise InputError(
                f"{where}: values have shape {values.shape}, the axes need ({latitude.size},"
                f" {longitude.size})"
            )
        if values.dtype not in (np.float64, np.float32) or not values.dtype.isnative:
            values = values.astype(np.float64)
        values = np.ascontiguousarray(values)
        step = longitude[1] - longitude[0]
        if longitude[-1] - longitude[0] > 2.0 * math.pi + 1e-3 * step:
            raise InputError(f"{where}: longitudes go round the Earth more than once")
        drop = is_periodic(longitude.size - 1, step)  # the last meridian repeats the first
        if drop:
            longitude, values = longitude[:-1], np.ascontiguousarray(values[:, :-1])
        if not any(np.isfinite(row).any() for row in values):
            raise EmptyWindowError(f"{where}: has no value at all (all missing)")
        object.__setattr__(self, "latitude", latitude)
        object.__setattr__(self, "longitude", longitude)
        object.__setattr__(self, "values", values)
        self._check_errors(where, drop)

    def _check_errors(self, where: str, drop: bool) -> None:
        shape = self.values.shape
        for name, wanted in zip(_ERRORS_AT_NODES, (shape, (*shape, 3)), strict=True):
            if np.ndim(given := getattr(self, name)) == 0:  # one number, or None
                continue
            array = np.asarray(real_numbers(given, f"{where}: {name}"), dtype=np.float64)
            array = np.ascontiguousarray(array[:, :-1] if drop and array.ndim > 1 else array)
            if array.shape != wanted:
                raise InputError(f"{where}: {name} has shape {array.shape}, the values {shape}")
            object.__setattr__(self, name, array)
        if self.error_ellipses is not None and impossible(self.error_ellipses).any():
            raise InputError(f"{where}: correlation lengths must be > 0 m")
        for name, allowed, least in (
            ("sigma", ">= 0", 0.0),
            ("correlation_length", "> 0 m", math.ulp(0.0)),
            ("height", "finite", -math.inf),
            ("quantisation", ">= 0", 0.0),
            ("unresolved", ">= 0", 0.0),
        ):
            value = getattr(self, name)
            if value is None:
                continue
            if np.ndim(value):  # where NaN = not known
                if np.less(value, least).any():
                    raise InputError(f"{where}: {name} must be {allowed}")
            elif not (math.isfinite(value) and value >= least):
                raise InputError(f"{where}: {name} must be {allowed}, is {value}")
        if np.ndim(self.sigma) == 0 or not np.isfinite(self.sigma).any():  # said of no node
            object.__setattr__(self, "sigma", 0.0 if np.ndim(self.sigma) else float(self.sigma))

    @cached_property
    def grid(self) -> Grid:
        """The grid as the kernels of `isogal.maps.interpolation` take it."""
        return Grid(
            self.values,
            self.latitude.size,
            float(self.latitude[0]),
            float((self.latitude[-1] - self.latitude[0]) / (self.latitude.size - 1)),
            float(self.longitude[0]),
            float((self.longitude[-1] - self.longitude[0]) / (self.longitude.size - 1)),
        )

    @cached_property
    def resolved(self) -> "FieldMap":
        """The map whose `sigma` is of errors that hold together over its lengths alone."""
        if not self.unresolved:
            return self
        rest = np.asarray(self.sigma) ** 2 - self.unresolved**2
        return replace(self, sigma=np.sqrt(np.maximum(rest, 0.0)), unresolved=0.0)

    @cached_property
    def scale(self) -> float:
        """Standard deviation of the values, by a sample of at most 200 x 200 nodes."""
        steps = [max(1, count // 200) for count in self.values.shape]
        return float(np.nanstd(self.values[:: steps[0], :: steps[1]]))

    @cached_property
    def roughness(self) -> float:
        """RMS difference of a node from the mean of its neighbours on either side, by at most 200
        x 200 nodes; 0 where nothing is known."""
        steps, values = [max(1, count // 200) for count in self.values.shape], self.values
        along = values[1:-1] - 0.5 * (values[2:] + values[:-2])
        across = values[:, 1:-1] - 0.5 * (values[:, 2:] + values[:, :-2])
        each = [part[:: steps[0], :: steps[1]].ravel() for part in (along, across)]
        known = np.concatenate(each)
        known = known[np.isfinite(known)]
        return math.sqrt(float((known**2).mean())) if known.size else 0.0

    @cached_property
    def sigma_grid(self) -> Grid:
        """What the map says of its error at its nodes; one node where it says one number."""
        return self.grid._replace(
            values=np.ascontiguousarray(np.atleast_2d(self.sigma), dtype=np.float64)
        )

    @cached_property
    def usual_sigma(self) -> float:
        """Mean of what the map says of its own error; 0 where it says nothing of the whole of
        it."""
        if self.error_stated is False:
            return 0.0
        sigma = np.asarray(self.sigma, dtype=np.float64)
        known = sigma[np.isfinite(sigma)]
        return float(known.mean()) if known.size else 0.0

    @property
    def states_error(self) -> bool:
        """Whether the map says how wrong it is."""
        stated = self.error_stated
        return bool(np.any(np.nan_to_num(self.sigma) > 0.0)) if stated is None else stated

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.latitude.size, self.longitude.size

    @property
    def step(self) -> tuple[float, float]:
        """From row to row and from column to column, rad."""
        return self.grid.latitude_step, self.grid.longitude_step

    @property
    def extent(self) -> Window:
        """South, north, west and east node, rad."""
        lat, lon = self.latitude, self.longitude
        return Window(float(lat[0]), float(lat[-1]), float(lon[0]), float(lon[-1]))

    def value(self, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """Interpolate at points (rad, any shapes that broadcast); NaN where the map has no
        value."""
        lat, lon, shape = flat_points(latitude, longitude)
        return values_at(self.grid, lat, lon).reshape(shape)[()]

    def value_and_gradient(
        self, latitude: ArrayLike, longitude: ArrayLike
    ) -> tuple[Array, Array, Array]:
        """Interpolate value, derivative to the north and to the east, per metre on the ellipsoid.

        Any shapes that broadcast, rad. NaN where the map has no value.
        """
        lat, lon, shape = flat_points(latitude, longitude)
        value, by_lat, by_lon = values_and_gradients(self.grid, lat, lon)
        north, east = metres_per_radian(lat)
        return (
            value.reshape(shape)[()],
            (by_lat / north).reshape(shape)[()],
            (by_lon / east).reshape(shape)[()],
        )

    def sigma_at(self, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """Return the 1-sigma of the map's error at points (rad), linear between nodes; NaN where
        the map has none."""
        return self.linear(self.sigma, latitude, longitude)

    def error_ellipse_at(self, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """Return (..., 3) the ellipse of the error's correlation at points (rad), linear between
        nodes; NaN where the map does not say it."""
        ellipses = np.full(3, math.nan) if self.error_ellipses is None else self.error_ellipses
        parts = (self.linear(ellipses[..., k], latitude, longitude) for k in range(3))
        return np.stack(list(parts), axis=-1)

    def linear(self, nodes: float | Array, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """Return at points (rad) what is said at the map's nodes (n, m), linear between them, or
        everywhere (one number)."""
        lat, lon, shape = flat_points(latitude, longitude)
        if np.ndim(nodes) == 0:
            return np.full(shape, nodes)[()]
        grid = self.grid._replace(values=np.ascontiguousarray(nodes))
        return bilinear_at(grid, lat, lon).reshape(shape)[()]

    def on_grid_of(self, other: "FieldMap") -> bool:
        """Tell whether the nodes are those of another map."""
        same = self.shape == other.shape
        return same and np.allclose(self.grid[2:], other.grid[2:], rtol=1e-12)

    def covers(self, latitude: ArrayLike, longitude: ArrayLike) -> Booleans:
        """Tell where the map has a value (all sixteen nodes around the point)."""
        return np.isfinite(self.value(latitude, longitude))

    def cell_size_m(self, latitude: float) -> tuple[float, float]:
        """Return the distance between nodes (to the north, to the east), m, at a latitude
        (rad)."""
        north, east = metres_per_radian(latitude)
        return float(self.step[0] * north), float(self.step[1] * east)

    @property
    def cell(self) -> tuple[float, float]:
        """Distance between nodes (to the north, to the east), m, in the map's middle."""
        return self.cell_size_m(float(self.latitude.mean()))

    def window(self, lat_min: float, lat_max: float, lon_min: float, lon_max: float) -> "FieldMap":
        """Cut out a part (rad), with the nodes beyond it that interpolation at its edge needs.

        Parameters
        ----------
        lat_min, lat_max, lon_min, lon_max : float
            rad. Longitudes may be given in any range; ``lon_max < lon_min`` crosses the date line.

        Raises
        ------
        InputError
            Nothing of the map lies there.
        """
        window = Window(lat_min, lat_max, lon_min, lon_max)
        part = part_within(self.latitude, self.longitude, window, self.provenance or self.quantity)
        return self._cut(part.latitude, part.longitude, part.of)

    def overview(self, most: int, window: Window | None = None) -> "FieldMap":
        """Return the map, or a window of it, thinned to at most ``most`` rows and columns."""
        whole = self if window is None else self.window(*window[:4])
        rows, columns = (-(-n // most) for n in whole.shape)
        return whole.thinned(rows, columns)

    def thinned(self, rows: int, columns: int) -> "FieldMap":
        """Keep every so many-th row and column only, at least four of each."""
        rows, columns = (
            max(1, min(step, (n - 1) // 3))
            for step, n in zip((rows, columns), self.shape, strict=True)
        )
        return self.part(slice(None, None, rows), slice(None, None, columns))

    def part(self, rows: slice, columns: slice) -> "FieldMap":
        """Return some rows and columns."""
        return self._cut(
            self.latitude[rows], self.longitude[columns], lambda array: array[rows, columns]
        )

    def _cut(
        self, latitude: Array, longitude: Array, cut: Callable[[Values], Values]
    ) -> "FieldMap":
        """Return a part with these axes: each array of the nodes (n, m, ...) cut in one way."""
        arrays = (getattr(self, name) for name in _ERRORS_AT_NODES)
        sigma, ellipses = (
            np.asarray(cut(one), dtype=np.float64) if np.ndim(one) else one for one in arrays
        )
        return replace(
            self,
            latitude=latitude,
            longitude=longitude,
            values=cut(self.values),
            sigma=sigma,
            error_ellipses=ellipses,
        )

    def near(self, latitude: ArrayLike, longitude: ArrayLike) -> "FieldMap":
        """Return the map around points (see `isogal.maps.tiled_map`): of a map in memory all of
        it."""
        return self

    def parts(self) -> Iterator["FieldMap"]:
        """Yield the map in parts (see `isogal.maps.tiled_map`): a map in memory is one part."""
        yield self


def flat_points(latitude: ArrayLike, longitude: ArrayLike) -> tuple[Array, Array, tuple[int, ...]]:
    """Return points (rad, any shapes that broadcast) as two arrays (N,), and their shape."""
    lat, lon = np.broadcast_arrays(
        real_numbers(latitude, "latitude").astype(np.float64, copy=False),
        real_numbers(longitude, "longitude").astype(np.float64, copy=False),
    )
    return np.ascontiguousarray(lat).reshape(-1), np.ascontiguousarray(lon).reshape(-1), lat.shape


def delegated(place: Callable[[Any], FieldMap], name: str) -> Any:
    """Return a property of something made of maps: what one of them says."""
    return property(lambda whole: getattr(place(whole), name))
