"""``isogal map``: look at maps, make, fetch and convert them."""

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isogal.cli.map_options import (
    ERRORS,
    MAP,
    OUT,
    Bars,
    Crs,
    Figure,
    FormatName,
    Json,
    Margin,
    Quantity,
    Route,
    ScenarioFile,
    Set,
    Source,
    Unit,
    Variable,
    WindowOption,
    load,
    part_of,
    route_of,
)
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.field_map import FieldMap

app = typer.Typer(
    no_args_is_help=True, add_completion=False, help="Look at maps, make, fetch and convert them."
)


@app.command()
def info(
    source: Source,
    variable: Variable = None,
    quantity: Quantity = None,
    unit: Unit = None,
    crs: Crs = None,
    format_name: FormatName = None,
    scenario: ScenarioFile = None,
    set_: Set = None,
    route: Route = None,
    window: WindowOption = None,
    margin: Margin = 25.0,
    stretch: Annotated[
        float,
        typer.Option(
            "--stretch",
            metavar="KM",
            min=0.1,
            help="Track that a fix is made from.",
            rich_help_panel=ERRORS,
        ),
    ] = 5.0,
    sensor_sigma: Annotated[
        float | None,
        typer.Option(
            "--sensor-sigma",
            help="1-sigma of a reading, map's unit; default: gravimeter.sigma.",
            rich_help_panel=ERRORS,
        ),
    ] = None,
    map_sigma: Annotated[
        float | None,
        typer.Option(
            "--map-sigma",
            help="1-sigma of the map, its unit; default: as the map says.",
            rich_help_panel=ERRORS,
        ),
    ] = None,
    correlation_length: Annotated[
        float | None,
        typer.Option(
            "--map-correlation-length",
            metavar="M",
            help="Of the map's error; default: as the map says, or 4000.",
            rich_help_panel=ERRORS,
        ),
    ] = None,
    bias_sigma: Annotated[
        float,
        typer.Option(
            "--bias-sigma",
            min=0.0,
            help="1-sigma of an unknown offset, map's unit.",
            rich_help_panel=ERRORS,
        ),
    ] = 0.0,
    figure: Figure = None,
    json: Json = False,
) -> None:
    """Say what a map is; with a route (--scenario, --set or --route), how good fixes can be along
    it.

    The expected accuracy is the bound on a fix from the readings of one stretch alone, for a
    position already known to within the linear range of the map."""
    from isogal.cli import map_description as map_report

    settings, trajectory = route_of(
        scenario, set_, route, always=source == "synthetic" and window is None
    )
    field_map = load(
        source,
        (variable, quantity, unit, crs, format_name),
        settings,
        part_of(trajectory, window, margin),
    )
    found = map_report.describe_map(field_map)
    track = stretches = None
    if settings is not None and trajectory is not None:
        from isogal.maps.expected_accuracy import Errors, position_information
        from isogal.maps.load import check_coverage

        scans = slice(None, None, settings.steps_per_scan)
        track = trajectory.latitude[scans], trajectory.longitude[scans]
        check_coverage(field_map, *track)
        if sensor_sigma is None and field_map.unit != "m/s²":
            raise InputError(f"--sensor-sigma: must be given for a map in {field_map.unit}")
        errors = Errors(
            settings.gravimeter.sigma if sensor_sigma is None else sensor_sigma,
            map_sigma,
            correlation_length
            or field_map.correlation_length
            or settings.matcher.map_correlation_length,
            bias_sigma,
        )
        stretches = position_information(field_map, *track, errors, 1e3 * stretch)
        value, north, east = field_map.value_and_gradient(*track)
        found["route"] = map_report.describe_route(value, (north**2 + east**2) ** 0.5, stretches)
    if figure is not None:
        from isogal.cli.map_figures import map_figure

        _draw(figure, map_figure(field_map, track, stretches))
    if json:
        _print_json(found)
        return
    map_report.print_map(found)
    if "route" in found:
        map_report.print_route(found["route"], field_map.unit)
    if figure is not None:
        typer.echo(str(figure))


@app.command()
def variability(
    source: Source,
    variable: Variable = None,
    quantity: Quantity = None,
    unit: Unit = None,
    crs: Crs = None,
    format_name: FormatName = None,
    scenario: ScenarioFile = None,
    set_: Set = None,
    route: Route = None,
    margin: Margin = 25.0,
    half_width: Annotated[
        float,
        typer.Option(
            "--half-width",
            metavar="M",
            min=1.0,
            help="Of the window template.",
            rich_help_panel=ERRORS,
        ),
    ] = 2000.0,
    points: Annotated[
        int,
        typer.Option(
            "--points", min=3, help="Along each side of the template, odd.", rich_help_panel=ERRORS
        ),
    ] = 9,
    samples: Annotated[
        int,
        typer.Option(
            "--samples",
            min=1,
            help="Places that the normalisation looks back over.",
            rich_help_panel=ERRORS,
        ),
    ] = 100,
    figure: Figure = None,
    json: Json = False,
) -> None:
    """Compute the map feature variability (paper eq. CV) at each reading along a route."""
    from isogal.maps.expected_accuracy import along_track
    from isogal.maps.load import check_coverage
    from isogal.maps.variability import feature_variability, normalised_variability

    settings, trajectory = route_of(scenario, set_, route, always=True)
    assert settings is not None and trajectory is not None
    field_map = load(
        source,
        (variable, quantity, unit, crs, format_name),
        settings,
        part_of(trajectory, None, margin),
    )
    scans = slice(None, None, settings.steps_per_scan)
    latitude, longitude = trajectory.latitude[scans], trajectory.longitude[scans]
    check_coverage(field_map, latitude, longitude)
    distance = along_track(latitude, longitude)
    spread = feature_variability(field_map, latitude, longitude, half_width, points)
    relative = normalised_variability(spread, samples)
    if figure is not None:
        from isogal.cli.map_figures import variability_figure

        value = field_map.value(latitude, longitude)
        _draw(figure, variability_figure(field_map, distance, value, spread, relative))
    if json:
        names = ("distance_km", "latitude", "longitude", "variability", "normalised")
        _print_json(
            {
                "quantity": field_map.quantity,
                "unit": f"({field_map.unit})²",
                "half_width": half_width,
                "points": points,
                "samples": samples,
                "places": [
                    dict(zip(names, (float(x) for x in row), strict=True))
                    for row in zip(
                        distance / 1e3,
                        _degrees(latitude),
                        _degrees(longitude),
                        spread,
                        relative,
                        strict=True,
                    )
                ],
            }
        )
        return
    _print_variability(field_map, distance, spread, relative)
    if figure is not None:
        typer.echo(str(figure))


@app.command()
def synth(
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE.nc", help="Map to write.", rich_help_panel=OUT)
    ],
    quantity: Annotated[
        str,
        typer.Option("--quantity", help="gravity, disturbance or height.", rich_help_panel=MAP),
    ] = "gravity",
    scenario: ScenarioFile = None,
    set_: Set = None,
    route: Route = None,
    window: WindowOption = None,
    margin: Margin = 25.0,
    json: Json = False,
) -> None:
    """Write the synthetic map of a route or window as NetCDF; it is the same everywhere and
    always."""
    from isogal.cli.map_description import describe_map, print_map
    from isogal.maps.formats.netcdf import write_netcdf
    from isogal.maps.synthetic.tiles import synthetic_map

    _, trajectory = route_of(scenario, set_, route, always=window is None)
    part = part_of(trajectory, window, margin)
    assert part is not None
    with Bars("tiles") as progress:
        field_map = synthetic_map(
            quantity, part._replace(track=None), lambda done, total: progress("tiles", done, total)
        )
    write_netcdf(field_map, out)
    found = describe_map(field_map) | {"file": str(out)}
    if json:
        _print_json(found)
    else:
        print_map(found)
        typer.echo(str(out))


@app.command()
def fetch(
    base_url: Annotated[
        str,
        typer.Option(
            "--base-url",
            metavar="URL",
            help="Folder of a mirror that holds the folders ga, dg, ...: https://ddfe.curtin.edu.au/gravitymodels/GGMplus/data"
            " or https://ddfe.blazejbucha.com/models/GGMplus/data.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="Folder of the tiles.", rich_help_panel=OUT),
    ] = Path("ggmplus"),
    variable: Annotated[
        list[str] | None,
        typer.Option(
            "--variable",
            metavar="NAME",
            help="ga, dg, xi, eta or ha; repeatable; default: by gravimeter.quantity.",
            rich_help_panel=MAP,
        ),
    ] = None,
    scenario: ScenarioFile = None,
    set_: Set = None,
    route: Route = None,
    window: WindowOption = None,
    margin: Margin = 25.0,
    timeout: Annotated[
        float,
        typer.Option(
            "--timeout", metavar="S", min=0.1, help="Seconds without a byte before another try."
        ),
    ] = 30.0,
    tries: Annotated[
        int, typer.Option("--tries", min=1, help="Tries in a row that bring nothing new.")
    ] = 5,
    json: Json = False,
) -> None:
    """Fetch the GGMplus tiles that a route needs (default: the default route); go on where an
    earlier fetch broke off.

    The mirrors publish no checksums: a tile is trusted when it first arrives, its SHA-256 is kept
    in checksums.txt beside it, and a tile that differs from that later is refused."""
    from isogal.maps.ggmplus.download import Patience
    from isogal.maps.ggmplus.fetch import fetch_tiles, tiles_for
    from isogal.scenario import load_scenario

    settings, trajectory = route_of(scenario, set_, route, always=window is None)
    part = part_of(trajectory, window, margin)
    assert part is not None
    quantity = (settings or load_scenario()).gravimeter.quantity
    names = tiles_for(part, variable or ["ga" if quantity == "gravity" else "dg"])
    with Bars("bytes") as progress:
        result = fetch_tiles(
            names, base_url, out, patience=Patience(timeout, tries), progress=progress
        )
    if json:
        _print_json(result.record())
        return
    for name in names:
        state = (
            "fetched"
            if name in result.downloaded
            else "there already"
            if name in result.present
            else "not on the server (open sea?)"
        )
        typer.echo(f"{name}  {state}{', trusted on first use' if name in result.trusted else ''}")
    typer.echo(f"map.source: {out}")


@app.command()
def convert(
    source: Source,
    out: Annotated[
        Path,
        typer.Argument(metavar="OUT", help="NetCDF file to write; with --to ggmplus, a folder."),
    ],
    variable: Variable = None,
    quantity: Quantity = None,
    unit: Unit = None,
    crs: Crs = None,
    format_name: FormatName = None,
    to: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="netcdf or ggmplus.", rich_help_panel=OUT)
    ] = "netcdf",
    sigma: Annotated[
        float | None,
        typer.Option(
            "--sigma",
            min=0.0,
            help="1-sigma of the map's error to write into it, SI (nT).",
            rich_help_panel=OUT,
        ),
    ] = None,
    correlation_length: Annotated[
        float | None,
        typer.Option(
            "--correlation-length", metavar="M", help="Of that error.", rich_help_panel=OUT
        ),
    ] = None,
    scenario: ScenarioFile = None,
    set_: Set = None,
    route: Route = None,
    window: WindowOption = None,
    margin: Margin = 25.0,
    json: Json = False,
) -> None:
    """Convert a map to NetCDF that says everything about itself, in SI units; whole, or the part
    of a route or window."""
    from dataclasses import replace

    from isogal.cli.map_description import describe_map, print_map
    from isogal.maps.formats.netcdf import write_netcdf
    from isogal.maps.ggmplus.folder import write_ggmplus

    if to not in ("netcdf", "ggmplus"):
        raise InputError(f"--to {to}: must be netcdf or ggmplus")
    if to == "netcdf" and out.suffix.casefold() not in (".nc", ".nc4"):
        raise InputError(f"{out}: must end in .nc (or give --to ggmplus)")
    settings, trajectory = route_of(scenario, set_, route, always=False)
    part = part_of(trajectory, window, margin)
    field_map = load(
        source,
        (variable, quantity, unit, crs, format_name),
        settings,
        part._replace(track=None) if part else None,
    )
    changes: dict[str, Any] = {} if sigma is None else {"sigma": sigma}
    if correlation_length is not None:
        changes["correlation_length"] = correlation_length
    field_map = replace(field_map, **changes)
    if to == "netcdf":
        write_netcdf(field_map, out, variable if variable and variable.isidentifier() else None)
    else:
        write_ggmplus(field_map, out)
    found = describe_map(field_map) | {"file": str(out)}
    if json:
        _print_json(found)
    else:
        print_map(found)
        typer.echo(str(out))


def _draw(path: Path, figure: Any) -> None:
    from isogal.evaluation.figures.style import png
    from isogal.files import write_atomic

    if path.suffix.casefold() != ".png":
        raise InputError(f"--figure {path}: must end in .png")
    write_atomic(path, png(figure), make_folder=True)


def _print_json(found: dict[str, Any]) -> None:
    typer.echo(json_module.dumps(found, indent=2, ensure_ascii=False, allow_nan=False))


def _print_variability(field_map: "FieldMap", distance: Any, spread: Any, relative: Any) -> None:
    import numpy as np
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    factor, unit = (1e5, "mGal") if field_map.unit == "m/s²" else (1.0, field_map.unit)
    table = Table(
        box=SIMPLE_HEAD,
        title=f"Map feature variability of {field_map.provenance}",
        title_justify="left",
    )
    for heading in ("km", f"root of C ({unit})", "normalised"):
        table.add_column(heading, justify="right")
    for first in range(0, distance.size, 50):
        part = slice(first, min(first + 50, distance.size))
        end = distance[part][-1] / 1e3
        table.add_row(
            f"{distance[part][0] / 1e3:.0f} to {end:.0f}",
            f"{factor * np.sqrt(np.mean(spread[part])):.3g}",
            f"{np.mean(relative[part]):.3g}",
        )
    Console().print(table, highlight=False)


def _degrees(values: Any) -> Any:
    import numpy as np

    return np.degrees(values)
