"""Which map does a source mean? The registry of formats, and the map of a scenario."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from isogal.errors import InputError
from isogal.maps.axes import Track, Window
from isogal.maps.channels import AnyMap
from isogal.maps.field_map import FieldMap
from isogal.maps.gdf import read_gdf
from isogal.maps.geotiff import read_geotiff
from isogal.maps.ggmplus import is_ggmplus, read_ggmplus
from isogal.maps.netcdf import read_netcdf
from isogal.maps.xyz import read_xyz
from isogal.scenario import Scenario
from isogal.sensors.fields import measured_field

Array = NDArray[np.float64]
CORRIDOR_MARGIN = 25_000.0
"""m of map kept around a route by default."""


class Reader(Protocol):
    """How every format is read."""

    def __call__(
        self, path: Path, variable: str | None, window: Window | None, *, quantity: str | None, unit: str | None
    ) -> FieldMap:
        """Read a map; raises InputError."""
        ...


class Route(Protocol):
    """The part of `isogal.sensors.trajectory.Trajectory` that a map needs."""

    @property
    def latitude(self) -> Array:
        """(K,) rad."""
        ...

    @property
    def longitude(self) -> Array:
        """(K,) rad."""
        ...


@dataclass(frozen=True)
class Format:
    """One map format: its name in scenarios, what it recognises, and its reader."""

    name: str
    matches: Callable[[Path], bool]
    read: Reader


def _suffix(*suffixes: str) -> Callable[[Path], bool]:
    return lambda path: path.suffix.casefold() in suffixes


FORMATS: tuple[Format, ...] = (
    Format("netcdf", _suffix(".nc", ".nc4", ".grd", ".cdf"), read_netcdf),
    Format("ggmplus", is_ggmplus, read_ggmplus),
    Format("geotiff", _suffix(".tif", ".tiff", ".gtiff"), read_geotiff),
    Format("gdf", _suffix(".gdf"), read_gdf),
    Format("xyz", _suffix(".xyz", ".txt", ".csv", ".dat"), read_xyz),
)
"""Known formats; to add one, write its reader and its line here."""


def load_map(
    source: str | Path,
    variable: str | None = None,
    quantity: str | None = None,
    window: Window | None = None,
    *,
    unit: str | None = None,
    crs: str | None = None,
    format_name: str | None = None,
) -> FieldMap:
    """Read a map from a file or folder.

    Parameters
    ----------
    source : path
        File or folder.
    variable : str, optional
        Variable, band or extension, where a source holds several.
    quantity, unit : str, optional
        What the numbers are, where the source does not say.
    window : Window, optional
        Only this part.
    crs : str, optional
        Coordinate reference system of a GeoTIFF that does not say.
    format_name : str, optional
        One of `FORMATS`; None = by suffix or content of the folder.

    Raises
    ------
    InputError
        No such file, unknown format, and whatever the reader refuses.
    """
    path = Path(source).expanduser()
    names = ", ".join(f.name for f in FORMATS)
    if format_name is not None:
        chosen = [f for f in FORMATS if f.name == format_name]
        if not chosen:
            raise InputError(f"map: unknown format '{format_name}'; known: {names}")
    else:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
        chosen = [f for f in FORMATS if f.matches(path)]
        if not chosen:
            raise InputError(f"{path}: not a known map format by its name; known: {names}")
    if crs is not None:
        if chosen[0].read is not read_geotiff:
            raise InputError(f"{path}: crs can only be given for geotiff, not for {chosen[0].name}")
        return read_geotiff(path, variable, window, quantity=quantity, unit=unit, crs=crs)
    return chosen[0].read(path, variable, window, quantity=quantity, unit=unit)


def route_window(latitude: Array, longitude: Array, margin: float = CORRIDOR_MARGIN) -> Window:
    """Return the window around route points (rad) with a margin (m); routes may cross the date line."""
    turned = np.unwrap(longitude)
    around = Window(latitude.min(), latitude.max(), turned.min(), turned.max()).grown(margin)
    return around._replace(track=Track(latitude, turned, margin))


def map_for_scenario(scenario: Scenario, trajectory: Route | None = None, margin: float = CORRIDOR_MARGIN) -> AnyMap:
    """Return the map of what a scenario measures, cut to its route.

    Parameters
    ----------
    scenario : Scenario
        Its ``map``, field and route.
    trajectory : Trajectory, optional
        The route's points, if they are there already.
    margin : float
        m of map kept around the route, as far as the map reaches.

    Returns
    -------
    FieldMap, or ChannelMap of a field with several channels

    Raises
    ------
    InputError
        The map cannot be read, is of another quantity than is needed, or does not cover the route.
    """
    if measured_field(scenario).vector is None:
        return source_map(scenario, trajectory, margin)
    from isogal.maps.derived import derived_maps

    return derived_maps(scenario, margin)


def source_map(scenario: Scenario, trajectory: Route | None = None, margin: float = CORRIDOR_MARGIN) -> FieldMap:
    """Return the map that a scenario names; for several channels, all of it that theirs are computed from.

    Parameters
    ----------
    scenario : Scenario
        Its ``map``, field and route.
    trajectory : Trajectory, optional
        The route's points, if they are there already.
    margin : float
        m of map kept around the route, as far as the map reaches.

    Raises
    ------
    InputError
        The map cannot be read, is of another quantity than the sensor, or does not cover the route.
    """
    route = trajectory or _route(scenario)
    field = measured_field(scenario)
    quantity, vector = field.source, field.vector
    window = route_window(route.latitude, route.longitude, margin)
    if vector is not None:
        window = window.grown(vector.reach)  # and all of it, also what is off the track
    source, path = scenario.map.source, scenario.map.path
    if source == "synthetic":
        from isogal.maps.synthetic import synthetic_map

        field_map = synthetic_map(_synthetic_quantity(scenario), window)
    else:
        named = source in {f.name for f in FORMATS}
        if named and path is None:
            raise InputError(f"map.path: must name the file or folder, since map.source is the format '{source}'")
        if not named and path is not None:
            raise InputError(
                f"map.source: must be 'synthetic' or a format ({', '.join(f.name for f in FORMATS)}) where map.path is given"
            )
        variable = scenario.map.variable
        field_map = load_map(
            path if named and path is not None else source,
            variable,
            None if variable else quantity,
            window,
            format_name=source if named else None,
        )
    if field_map.quantity != quantity:
        needs = "" if vector is None else f", which needs one of {quantity}"
        key = "field" if scenario.field else "gravimeter.quantity"
        raise InputError(
            f"map: {field_map.provenance} is a {field_map.quantity} map, but {key} is {scenario.measured_field}{needs};"
            f" change map.variable or {key}"
        )
    check_coverage(field_map, route.latitude, route.longitude)
    return field_map


def check_coverage(field_map: AnyMap, latitude: Array, longitude: Array) -> None:
    """Raise InputError unless the map has a value at every route point; names the first without, and the map's extent."""
    bare = ~field_map.covers(latitude, longitude)
    if bare.any():
        first = int(np.argmax(bare))
        at = f"{math.degrees(latitude[first]):.4f}, {math.degrees(longitude[first]):.4f} deg"
        raise InputError(
            f"map: {field_map.provenance} ({field_map.extent.text()}) does not cover the route: no value at {at}"
            f" (point {first} of {latitude.size}; {int(bare.sum())} points have none)"
        )


def _route(scenario: Scenario) -> Route:
    from isogal.sensors.trajectory import build_trajectory

    return build_trajectory(scenario)


def _synthetic_quantity(scenario: Scenario) -> str:
    names = {
        "ga": "gravity",
        "dg": "disturbance",
        "gravity": "gravity",
        "disturbance": "disturbance",
        "height": "height",
        None: measured_field(scenario).source,
    }
    if scenario.map.variable not in names:
        raise InputError(f"map.variable: the synthetic map has height, ga and dg, not '{scenario.map.variable}'")
    return names[scenario.map.variable]
