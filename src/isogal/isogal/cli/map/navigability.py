"""``isogal map navigability``: where can one navigate?"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from isogal.cli.checks import NETCDF
from isogal.cli.map.part import PartChoice
from isogal.cli.map.results import Picture, draw
from isogal.cli.map_choice import MapChoice
from isogal.cli.option_groups import with_groups
from isogal.cli.options import RESULTS, Json, number, written_file
from isogal.cli.tables import print_json, print_table

if TYPE_CHECKING:
    from isogal.evaluation.navigability.area import Navigability


@dataclass(frozen=True)
class AreaResults:
    """What becomes of the grids."""

    PANEL: ClassVar[str] = RESULTS

    out: Annotated[
        list[Path] | None,
        written_file("FILE", "Grids as .nc or .tif; repeatable.", *NETCDF, ".tif", ".tiff"),
    ] = None
    figure: Picture = None
    json: Json = False


@with_groups
def navigability(
    map_: MapChoice,
    where: PartChoice,
    results: AreaResults,
    headings: Annotated[int, number("How many, evenly spread.", least=1, most=72)] = 8,
) -> None:
    """Compute how well one can navigate over the area of a map: the RMS error on arrival at each
    node after a straight leg, on the worst, all and the best headings, the probability of a second
    place, and the map feature variability.

    The error is the posterior Cramér-Rao bound with the scenario's sensors, speed, initial errors
    and batch length, and the error of the map. The route of the scenario counts only where it says
    the part of the map: without --window, --route or a route.* in --set the whole map is taken. It
    is taken as it is: at route.height the field is smoother (`isogal map continue`)."""
    from isogal.cli.progress import Bars
    from isogal.evaluation.navigability.area import navigability as compute
    from isogal.fields.measured import measured_field

    settings = where.load()
    part = where.part(where.build() if where.window is None and _along_a_route(where) else None)
    field_map = map_.load(part and part.window, measured_field(settings).source)
    with Bars("headings") as bars:
        found = compute(settings.true, field_map, headings, partial(bars, "headings"))
    _write(found, results)


def _along_a_route(where: PartChoice) -> bool:
    """Return whether a route says the part of the map."""
    return where.route is not None or any(
        item.partition("=")[0] in ("route.start", "route.end") for item in where.set_ or ()
    )


def _write(found: "Navigability", results: AreaResults) -> None:
    """Write the files and print the summary; raises InputError."""
    from isogal.evaluation.navigability.files import write_navigability

    for path in results.out or ():
        write_navigability(found, path)
    if results.figure is not None:
        from isogal.cli.map.figures import navigability_figure

        draw(results.figure, navigability_figure(found))
    summary = found.summary()
    if results.json:
        print_json(summary)
        return
    rows, columns = found.ambiguity.shape
    files = (*(results.out or ()), results.figure)
    print_table(
        ("", "least", "quarter", "median", "three quarters", "largest"),
        [
            (f"{name} ({unit})", *(f"{value:.3g}" for value in summary[name].values()))
            for name, (_, unit, _) in found.layers().items()
            if name in summary
        ],
        *(str(path) for path in files if path is not None),
        title=f"RMS error on arrival, {rows} x {columns} nodes, {len(found.heading)} headings;"
        f" without readings {found.prior:.0f} m",
    )
