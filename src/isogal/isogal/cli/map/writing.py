"""``isogal map synth``, ``convert``, ``grid`` and ``continue``: the commands that write a map as
NetCDF that says everything about itself."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from isogal.cli.checks import NETCDF, not_negative, positive
from isogal.cli.map.part import PartChoice
from isogal.cli.map.results import (
    NetcdfOut,
    save,
    shown_unit,
)
from isogal.cli.map_choice import ARGUMENTS, MAP, MapChoice, SourceOptions, make_synthetic
from isogal.cli.option_groups import with_groups
from isogal.cli.options import RESULTS, Json, flag, number, text, written_file
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.axes import Window
    from isogal.maps.field_map import FieldMap


@with_groups
def synth(
    out: Annotated[Path, written_file("FILE.nc", "Map to write.", *NETCDF)],
    where: PartChoice,
    quantity: Annotated[
        str, typer.Option(help="gravity, disturbance or height.", rich_help_panel=MAP)
    ] = "gravity",
    json: Json = False,
) -> None:
    """Write the synthetic map of a route or window as NetCDF; it is the same everywhere and
    always."""
    save(make_synthetic(quantity, where.part_needed().window), out, json)


@dataclass(frozen=True)
class StatedError:
    """What a map is to say of its error."""

    PANEL: ClassVar[str] = RESULTS

    sigma: Annotated[
        str | None,
        text("SIGMA", "1-sigma of the map's error to write into it, SI (nT) or as 2mGal."),
    ] = None
    correlation_length: Annotated[float | None, number("Of that error.", "M", positive)] = None

    def of(self, field_map: "FieldMap") -> "FieldMap":
        """Return a map that says it; raises InputError."""
        from isogal.cli.sigmas import parse_sigma

        sigma = parse_sigma(self.sigma, "--sigma", field_map, 1.0, possible=True)
        return replace(
            field_map,
            sigma=field_map.sigma if sigma is None else sigma,
            error_stated=field_map.error_stated if sigma is None else None,
            correlation_length=self.correlation_length or field_map.correlation_length,
        )


@with_groups
def convert(
    map_: MapChoice, out: NetcdfOut, error: StatedError, where: PartChoice, json: Json = False
) -> None:
    """Convert a map to NetCDF that says everything about itself, in SI units; whole, or the part
    of a route or window."""
    route = where.build_if_asked()
    part = where.part(route)
    field_map = map_.load(part and part.window, route.measured if route else "gravity")
    named = map_.variable if (map_.variable or "").isidentifier() else None
    save(error.of(field_map), out, json, variable=named)


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


@dataclass(frozen=True)
class Gridding:
    """How readings become a map."""

    PANEL: ClassVar[str] = "Gridding"

    method: Annotated[
        str,
        typer.Option(
            help="kriging; equivalent-sources, which continues readings of several heights; auto:"
            " the one that predicts readings better which were left out."
        ),
    ] = "auto"
    spacing: Annotated[
        float | None,
        number(
            "Between nodes; default: 2 to 1/32 of the gap between lines, as interpolation"
            " between nodes asks for.",
            "M",
            positive,
        ),
    ] = None
    block: Annotated[
        float | None,
        number(
            "Readings are averaged in blocks of this side, 0 = none; default: half of --spacing"
            " where that is given, else a 16th of the gap between lines.",
            "M",
            not_negative,
        ),
    ] = None
    trend: Annotated[int, number("Degree of the polynomial taken off first.", least=0, most=3)] = 1
    height: Annotated[
        float | None,
        number(
            "Of the map above the ellipsoid (equivalent sources); default: the readings' median.",
            "M",
        ),
    ] = None
    level: Annotated[bool, flag("--level", "Level survey lines where they cross.")] = False
    left_out: Annotated[
        str | None,
        typer.Option(
            "--leave-out",
            help="lines or blocks, to check and scale the 1-sigma; default: lines if there are"
            " any.",
        ),
    ] = None


@with_groups
def grid(readings: SurveyChoice, out: NetcdfOut, gridding: Gridding, json: Json = False) -> None:
    """Make a map of survey readings at points or along lines, with the 1-sigma and the correlation
    length of its error at every node.

    Readings are left out, by lines or blocks, and predicted from the others, to check the map and
    to learn where it is better and where worse."""
    from isogal.cli.progress import Bars
    from isogal.maps.gridding.gridder import GridSettings, grid_survey
    from isogal.maps.gridding.reading import read_survey

    settings = GridSettings(**vars(gridding))
    said = {"quantity": readings.quantity, "unit": readings.unit, "crs": readings.crs}
    with Bars("nodes") as bars:
        survey = read_survey(readings.survey, readings.variable, **said)
        field_map, model = grid_survey(survey, settings, bars)
    save(field_map, out, json, _lines(model.report, field_map.unit), survey=model.report)


def _lines(report: Mapping[str, Any], unit: str) -> Iterator[str]:
    """Say how readings that were left out agree with the map of the others."""
    factor, unit = shown_unit(unit)
    left_out, off = report["left_out"], report["mean_absolute_error"]
    for name, count in report.get("incomplete", {}).items():
        yield (
            f"{name} is not used: {count} of {report['readings']} readings have none (give all of"
            " them, or leave these readings out)"
        )
    tried = ", ".join(f"{name} {factor * error:.3g} {unit}" for name, error in off.items())
    yield f"method {report['method']}; mean absolute error of readings left out: {tried}"
    yield (
        f"nodes {report['spacing_m']:.4g} m apart; lines or stations are typically"
        f" {report['gap_m']:.4g} m apart"
    )
    yield (
        f"left out by {left_out['by']}: {left_out['readings']} readings, RMS"
        f" {factor * left_out['rms']:.3g} {unit}, mean NIS {left_out['nis']:.2f}"
        f" (1-sigma {left_out['nis_sigma']:.2f}), scaled by others than those it is of"
    )
    for row in left_out["by_distance"]:
        yield (
            f"  {row['distance_m']:8.0f} m from the next reading: RMS {factor * row['rms']:.3g}"
            f" {unit}, NIS {row['nis']:.2f}"
        )
    if far := report["far_off"]:
        unused = sum(not one["used"] for one in far)
        yield (
            f"readings over 6 of their 1-sigmas off what the others predict: {len(far)}, of which"
            f" {unused} are as far off those next to them and not used"
        )
    for one in far[:10]:
        when = f"line {one['line']}, " if "line" in one else ""
        when += f"time {one['time']:.10g}, " if "time" in one else ""
        place = f"latitude {one['latitude']:.5f}, longitude {one['longitude']:.5f}"
        said = f"  {when}{place}: {factor * one['off']:+.3g} {unit}, {one['sigmas']:.0f} sigmas"
        if not one["used"]:
            said += ", not used"
        yield said
    if crossings := report.get("cross_overs"):
        before, after = crossings["before"], crossings["after"]
        yield (
            f"{before['count']} crossings of lines: RMS difference {factor * before['rms']:.3g}"
            f" {unit}, levelled {factor * after['rms']:.3g} {unit}, each by the others alone"
            f" {factor * after['rms_left_out']:.3g} {unit};"
            f" {after['degrees_of_freedom']:.1f} degrees of freedom are left"
        )


@dataclass(frozen=True)
class Heights:
    """From where a map is continued, and to which level."""

    PANEL: ClassVar[str] = "Heights"

    height: Annotated[float, number("Level to continue to, above the ellipsoid.", "M")]
    from_height: Annotated[
        float | None, number("Level that the values hold on; default: as the map says.", "M")
    ] = None
    terrain: Annotated[
        Path | None,
        text("FILE", "Map of the ground's height, for values on the ground (GGMplus)."),
    ] = None
    downward_cutoff: Annotated[
        float | None,
        number("Leave out wavelengths shorter than this; needed downwards.", "KM", positive),
    ] = None
    edge: Annotated[
        float | None,
        number(
            "Rim that is left out; default: five times the way up or down.", "KM", not_negative
        ),
    ] = None

    def check(self) -> None:
        """Raise InputError where options do not go together."""
        for name, value in (
            ("--from-height", self.from_height),
            ("--downward-cutoff", self.downward_cutoff),
        ):
            if self.terrain is not None and value is not None:
                raise InputError(f"{name} {value:g}: cannot be given together with --terrain")

    def continued(self, field_map: "FieldMap", window: "Window | None") -> "FieldMap":
        """Return a map on the level; of the terrain only a window is read. Raises InputError."""
        from isogal.maps.continuation.level import to_level
        from isogal.maps.continuation.terrain import from_terrain
        from isogal.maps.load import load_map

        edge = None if self.edge is None else 1e3 * self.edge
        if self.terrain is not None:
            ground = load_map(self.terrain, quantity="height", window=window)
            return from_terrain(field_map, ground, self.height, edge=edge)
        cutoff = None if self.downward_cutoff is None else 1e3 * self.downward_cutoff
        return to_level(field_map, self.height, self.from_height, cutoff=cutoff, edge=edge)


@with_groups
def continue_(
    map_: MapChoice, out: NetcdfOut, heights: Heights, where: PartChoice, json: Json = False
) -> None:
    """Continue a map of gravity disturbances, magnetic anomalies or gradients to another height,
    and write it as NetCDF that says its height and its error there.

    From a level to a level, or with --terrain from the ground. Downwards only with
    --downward-cutoff."""
    heights.check()
    part = where.part(where.build_if_asked())
    window = part and part.window
    save(heights.continued(map_.load(window, "disturbance"), window), out, json)
