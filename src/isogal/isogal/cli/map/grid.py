"""``isogal map grid``: a map from survey readings, with its own 1-sigma at every node."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isogal.cli.checks import finite, not_negative, output_file, positive
from isogal.cli.map.results import print_json, require_netcdf_name
from isogal.cli.map_choice import MAP
from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json

if TYPE_CHECKING:
    from isogal.maps.field_map import FieldMap
    from isogal.maps.gridding.gridder import GridSettings
    from isogal.maps.gridding.survey import Survey

GRIDDING = "Gridding"
"""Heading of the options that say how readings become a map."""


@dataclass(frozen=True)
class SurveyChoice:
    """Which readings."""

    survey: Annotated[
        Path,
        typer.Argument(
            metavar="SURVEY", help="Readings: CSV or Geosoft XYZ text, or NetCDF of one dimension."
        ),
    ]
    variable: Annotated[
        str | None,
        typer.Option(
            "--variable", metavar="NAME", help="Column of the values.", rich_help_panel=MAP
        ),
    ] = None
    quantity: Annotated[
        str | None,
        typer.Option(
            "--quantity", help="What they are, where the file does not say.", rich_help_panel=MAP
        ),
    ] = None
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit", help="Of the values, where the file does not say.", rich_help_panel=MAP
        ),
    ] = None
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs", metavar="EPSG:N", help="System of columns x and y.", rich_help_panel=MAP
        ),
    ] = None

    def read(self) -> "Survey":
        """Read the file; raises InputError."""
        from isogal.maps.gridding.reading import read_survey

        said = {"quantity": self.quantity, "unit": self.unit, "crs": self.crs}
        return read_survey(self.survey, self.variable, **said)


@dataclass(frozen=True)
class Gridding:
    """How readings become a map."""

    method: Annotated[
        str,
        typer.Option(
            "--method",
            help="kriging, or sources: equivalent sources, for readings of several heights.",
            rich_help_panel=GRIDDING,
        ),
    ] = "kriging"
    spacing: Annotated[
        float | None,
        typer.Option(
            "--spacing",
            metavar="M",
            callback=positive,
            help="Between nodes; default: a third of the shortest correlation length.",
            rich_help_panel=GRIDDING,
        ),
    ] = None
    block: Annotated[
        float | None,
        typer.Option(
            "--block",
            metavar="M",
            callback=not_negative,
            help="Readings are averaged in blocks of this side, 0 = none; default: half of"
            " --spacing where that is given.",
            rich_help_panel=GRIDDING,
        ),
    ] = None
    trend: Annotated[
        int,
        typer.Option(
            "--trend",
            min=0,
            max=3,
            help="Degree of the polynomial taken off first.",
            rich_help_panel=GRIDDING,
        ),
    ] = 1
    height: Annotated[
        float | None,
        typer.Option(
            "--height",
            metavar="M",
            callback=finite,
            help="Of the map above the ellipsoid (sources); default: the readings' median.",
            rich_help_panel=GRIDDING,
        ),
    ] = None
    level: Annotated[
        bool,
        typer.Option(
            "--level", help="Level survey lines where they cross.", rich_help_panel=GRIDDING
        ),
    ] = False
    leave_out: Annotated[
        str | None,
        typer.Option(
            "--leave-out",
            help="lines or blocks, to check and scale the 1-sigma; default: lines if there are"
            " any.",
            rich_help_panel=GRIDDING,
        ),
    ] = None

    def settings(self) -> "GridSettings":
        """Return the same as the library takes it; raises InputError."""
        from isogal.maps.gridding.gridder import GridSettings

        return GridSettings(
            method=self.method,
            spacing=self.spacing,
            block=self.block,
            trend=self.trend,
            height=self.height,
            level=self.level,
            left_out=self.leave_out,
        )


@with_groups
def grid(
    readings: SurveyChoice,
    out: Annotated[
        Path, typer.Argument(metavar="OUT", callback=output_file, help="NetCDF file to write.")
    ],
    gridding: Gridding,
    json: Json = False,
) -> None:
    """Make a map of survey readings at points or along lines, with the 1-sigma and the correlation
    length of its error at every node.

    Readings are left out, by lines or blocks, and predicted from the others, to check the map and
    to learn where it is better and where worse."""
    from isogal.cli.map.description import describe_map
    from isogal.cli.progress import Bars
    from isogal.maps.formats.netcdf_writing import write_netcdf
    from isogal.maps.gridding.gridder import grid_survey

    require_netcdf_name(out)
    settings = gridding.settings()
    with Bars("nodes") as bars:
        field_map, model = grid_survey(
            readings.read(), settings, lambda done, total: bars("nodes", done, total)
        )
    write_netcdf(field_map, out)
    found = describe_map(field_map) | {"survey": model.report, "file": str(out)}
    if json:
        print_json(found)
    else:
        _print(found, field_map, out)


def _print(found: dict[str, Any], field_map: "FieldMap", out: Path) -> None:
    from isogal.cli.map.description import print_map

    print_map(found)
    factor, unit = (1e5, "mGal") if field_map.unit == "m/s²" else (1.0, field_map.unit)
    report = found["survey"]
    left_out = report["left_out"]
    typer.echo(
        f"left out by {left_out['by']}: {left_out['readings']} readings, RMS"
        f" {factor * left_out['rms']:.3g} {unit}, mean NIS {left_out['nis']:.2f}"
    )
    for row in left_out["by_distance"]:
        typer.echo(
            f"  {row['distance_m']:8.0f} m from the next reading: RMS {factor * row['rms']:.3g}"
            f" {unit}, NIS {row['nis']:.2f}"
        )
    if crossings := report.get("cross_overs"):
        before, after = crossings["before"], crossings["after"]
        typer.echo(
            f"{before['count']} crossings of lines: RMS difference {factor * before['rms']:.3g}"
            f" {unit}, levelled {factor * after['rms']:.3g} {unit}"
        )
    typer.echo(str(out))
