"""What the commands of `isogal map` have in common: options, and how they become a map, a route
and a window."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.axes import Window
    from isogal.maps.field_map import FieldMap
    from isogal.scenario import Scenario
    from isogal.sensors.trajectory import Trajectory

MAP, ROUTE, ERRORS, OUT = "Map", "Part of the Earth", "What is assumed", "Results"
Source = Annotated[
    str,
    typer.Argument(
        metavar="MAP", help="NetCDF, GeoTIFF, ICGEM or XYZ file, GGMplus folder, or 'synthetic'."
    ),
]
Variable = Annotated[
    str | None,
    typer.Option(
        "--variable",
        metavar="NAME",
        help="Variable, band, column or extension.",
        rich_help_panel=MAP,
    ),
]
Quantity = Annotated[
    str | None,
    typer.Option(
        "--quantity", help="What the map is of, where it does not say.", rich_help_panel=MAP
    ),
]
Unit = Annotated[
    str | None,
    typer.Option(
        "--unit", help="Unit of the numbers, where the file does not say.", rich_help_panel=MAP
    ),
]
Crs = Annotated[
    str | None,
    typer.Option(
        "--crs",
        metavar="EPSG:N",
        help="System of a GeoTIFF that does not say.",
        rich_help_panel=MAP,
    ),
]
FormatName = Annotated[
    str | None,
    typer.Option(
        "--format",
        metavar="NAME",
        help="netcdf, ggmplus, geotiff, gdf or xyz; default: by name.",
        rich_help_panel=MAP,
    ),
]
ScenarioFile = Annotated[
    Path | None,
    typer.Option(
        "--scenario",
        metavar="FILE",
        help="Scenario (YAML) whose route and sensor count.",
        rich_help_panel=ROUTE,
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key of the scenario; repeatable.",
        rich_help_panel=ROUTE,
    ),
]
Route = Annotated[
    str | None,
    typer.Option(
        "--route",
        metavar="'LAT,LON LAT,LON ...'",
        help="Route by its points, deg, instead of the scenario's.",
        rich_help_panel=ROUTE,
    ),
]
WindowOption = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option(
        "--window",
        metavar="SOUTH NORTH WEST EAST",
        help="Part of the map, deg.",
        rich_help_panel=ROUTE,
    ),
]
Margin = Annotated[
    float,
    typer.Option(
        "--margin", metavar="KM", min=0.0, help="Map kept around a route.", rich_help_panel=ROUTE
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON.", rich_help_panel=OUT)
]
Figure = Annotated[
    Path | None,
    typer.Option("--figure", metavar="FILE.png", help="Draw a picture.", rich_help_panel=OUT),
]


def route_of(
    scenario: Path | None, overrides: list[str] | None, route: str | None, always: bool
) -> "tuple[Scenario | None, Trajectory | None]":
    """Return the scenario and its trajectory if a route was asked for (or is always needed)."""
    if scenario is None and not overrides and route is None and not always:
        return None, None
    from isogal.scenario import load_scenario
    from isogal.sensors.trajectory import build_trajectory

    changes = list(overrides or ())
    if route is not None:
        changes += [f"route.waypoints={_waypoints(route)}", "route.duration=null"]
    settings = load_scenario(scenario, changes)
    return settings, build_trajectory(settings)


def _waypoints(route: str) -> str:
    points = []
    for item in route.split():
        latitude, comma, longitude = item.partition(",")
        try:
            points.append(f"[{float(latitude)},{float(longitude)},22.0]")
        except ValueError:
            comma = ""
        if not comma:
            raise InputError(
                f"--route: '{item}' must be LATITUDE,LONGITUDE in deg, for example '-38,144.5"
                " -35,150'"
            )
    return f"[{','.join(points)}]"


def part_of(
    trajectory: "Trajectory | None",
    window: tuple[float, float, float, float] | None,
    margin: float,
) -> "Window | None":
    """Return the part of the map that is wanted; None = all."""
    from isogal.maps.axes import Window
    from isogal.maps.load import route_window

    if window is not None:
        south, north, west, east = window
        if not (
            -90.0 <= south < north <= 90.0
            and -360.0 <= west <= 360.0
            and -360.0 <= east <= 360.0
            and west != east
        ):
            raise InputError(
                f"--window {' '.join(f'{x:g}' for x in window)}: must be SOUTH NORTH WEST EAST in"
                " deg, south below north"
            )
        return Window(*(float(x) for x in _radians(window)))  # type: ignore[arg-type]
    return (
        None
        if trajectory is None
        else route_window(trajectory.latitude, trajectory.longitude, 1e3 * margin)
    )


def load(
    source: str,
    meaning: tuple[str | None, str | None, str | None, str | None, str | None],
    settings: "Scenario | None",
    window: "Window | None",
) -> "FieldMap":
    """Read a map; ``meaning`` is variable, quantity, unit, crs and format as the user gave
    them."""
    from isogal.fields.measured import measured_field
    from isogal.maps.load import load_map
    from isogal.maps.synthetic.tiles import synthetic_map

    variable, quantity, unit, crs, format_name = meaning
    if source != "synthetic":
        return load_map(
            source, variable, quantity, window, unit=unit, crs=crs, format_name=format_name
        )
    if window is None:
        raise InputError("the synthetic map has no end: give --window, --route or --scenario")
    by_variable = {None: None, "ga": "gravity", "dg": "disturbance", "height": "height"}
    if variable not in by_variable:
        raise InputError(f"--variable {variable}: the synthetic map has height, ga and dg")
    quantity = (
        quantity
        or by_variable[variable]
        or (measured_field(settings).source if settings else "gravity")
    )
    with Bars("tiles") as progress:
        return synthetic_map(quantity, window, lambda done, total: progress("tiles", done, total))


def _radians(values: Any) -> Any:
    import numpy as np

    return np.radians(values)


class Bars:
    """A bar on the standard error stream for each thing that takes time; nothing where that is no
    terminal."""

    def __init__(self, unit: str) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            DownloadColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TransferSpeedColumn,
        )

        console = Console(stderr=True)
        columns: list[Any] = [TextColumn("{task.description}"), BarColumn()]
        columns += (
            [DownloadColumn(), TransferSpeedColumn()]
            if unit == "bytes"
            else [MofNCompleteColumn()]
        )
        self.bars = Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        )
        self.tasks: dict[str, Any] = {}

    def __enter__(self) -> "Bars":
        self.bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bars.stop()

    def __call__(self, name: str, done: int, total: int) -> None:
        """Move the bar of this name."""
        if name not in self.tasks:
            self.tasks[name] = self.bars.add_task(name, total=total)
        self.bars.update(self.tasks[name], completed=done)
