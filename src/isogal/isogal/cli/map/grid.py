"""``isogal map grid``: a map from survey readings, with its own 1-sigma at every node."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from isogal.cli.checks import finite, not_negative, positive
from isogal.cli.map.results import NetcdfOut, say_written
from isogal.cli.map_choice import ARGUMENTS, SourceOptions
from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json

if TYPE_CHECKING:
    from isogal.maps.gridding.gridder import GridSettings
    from isogal.maps.gridding.survey import Survey


@dataclass(frozen=True)
class SurveyChoice(SourceOptions):
    """Which readings."""

    survey: Annotated[
        Path,
        typer.Argument(
            metavar="SURVEY",
            help="Readings: CSV or Geosoft XYZ text, or NetCDF of one dimension.",
            rich_help_panel=ARGUMENTS,
        ),
    ]

    def read(self) -> "Survey":
        """Read the file; raises InputError."""
        from isogal.maps.gridding.reading import read_survey

        return read_survey(
            self.survey, self.variable, quantity=self.quantity, unit=self.unit, crs=self.crs
        )


@dataclass(frozen=True)
class Gridding:
    """How readings become a map."""

    PANEL: ClassVar[str] = "Gridding"

    method: Annotated[
        str,
        typer.Option(
            help="kriging, or sources: equivalent sources, for readings of several heights."
        ),
    ] = "kriging"
    spacing: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            callback=positive,
            help="Between nodes; default: a third of the shortest correlation length.",
        ),
    ] = None
    block: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            callback=not_negative,
            help="Readings are averaged in blocks of this side, 0 = none; default: half of"
            " --spacing where that is given.",
        ),
    ] = None
    trend: Annotated[
        int, typer.Option(min=0, max=3, help="Degree of the polynomial taken off first.")
    ] = 1
    height: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            callback=finite,
            help="Of the map above the ellipsoid (sources); default: the readings' median.",
        ),
    ] = None
    level: Annotated[
        bool, typer.Option("--level", help="Level survey lines where they cross.")
    ] = False
    left_out: Annotated[
        str | None,
        typer.Option(
            "--leave-out",
            help="lines or blocks, to check and scale the 1-sigma; default: lines if there are"
            " any.",
        ),
    ] = None

    def settings(self) -> "GridSettings":
        """Return the same as the library takes it; raises InputError."""
        from isogal.maps.gridding.gridder import GridSettings

        return GridSettings(**vars(self))


@with_groups
def grid(readings: SurveyChoice, out: NetcdfOut, gridding: Gridding, json: Json = False) -> None:
    """Make a map of survey readings at points or along lines, with the 1-sigma and the correlation
    length of its error at every node.

    Readings are left out, by lines or blocks, and predicted from the others, to check the map and
    to learn where it is better and where worse."""
    from isogal.cli.progress import Bars
    from isogal.maps.formats.netcdf_writing import write_netcdf
    from isogal.maps.gridding.gridder import grid_survey

    settings = gridding.settings()
    with Bars("nodes") as bars:
        field_map, model = grid_survey(
            readings.read(), settings, lambda done, total: bars("nodes", done, total)
        )
    write_netcdf(field_map, out)
    lines = _lines(model.report, field_map.unit)
    say_written(field_map, out, json, lines, survey=model.report)


def _lines(report: dict[str, Any], unit: str) -> Iterator[str]:
    factor, unit = (1e5, "mGal") if unit == "m/s²" else (1.0, unit)
    left_out = report["left_out"]
    yield (
        f"left out by {left_out['by']}: {left_out['readings']} readings, RMS"
        f" {factor * left_out['rms']:.3g} {unit}, mean NIS {left_out['nis']:.2f}"
    )
    for row in left_out["by_distance"]:
        yield (
            f"  {row['distance_m']:8.0f} m from the next reading: RMS {factor * row['rms']:.3g}"
            f" {unit}, NIS {row['nis']:.2f}"
        )
    if crossings := report.get("cross_overs"):
        before, after = crossings["before"], crossings["after"]
        yield (
            f"{before['count']} crossings of lines: RMS difference {factor * before['rms']:.3g}"
            f" {unit}, levelled {factor * after['rms']:.3g} {unit}"
        )
