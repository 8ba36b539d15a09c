"""``isogal view`` and ``isogal compare``: a run to look through, and runs or studies side by
side."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json, number, text, written_file, written_folder
from isogal.cli.run import TopicChoice, bag_of, require_ros
from isogal.cli.tables import print_json, print_table
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.evaluation.view.record import ViewedRun
    from isogal.maps.channels import RouteMap


@with_groups
def view(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="BAG|RUN",
            help="A recording, or the folder of a run or of a study (--out of the command).",
        ),
    ],
    topics: TopicChoice,
    out: Annotated[Path, written_file("FILE.html", "The page.", ".html")] = Path("out/view.html"),
    run: Annotated[int, number("Which run of a study.", "N", least=0)] = 0,
    scenario: Annotated[
        Path | None,
        text(
            "FILE",
            "Scenario of a recording that does not hold its own: which map, sensors, route.",
        ),
    ] = None,
) -> None:
    """Write one page to look through a run: tracks on the map, fixes, candidates, errors and what
    was claimed of them, readings and messages, under a slider of time.

    The page is one file and needs no network."""
    from isogal.evaluation.view.page import require_bokeh, write_view

    require_bokeh()
    viewed, field_map = _opened(source, run, scenario, topics)
    path = write_view(out, viewed, field_map)
    typer.echo(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")


def _opened(
    source: Path, run: int, scenario: Path | None, topics: TopicChoice
) -> "tuple[ViewedRun, RouteMap]":
    """Return what to show, from whatever was given."""
    bag = bag_of(source)
    if bag.is_file() or any(bag.glob("*.mcap*")) or any(bag.glob("*.db3*")):
        if run:
            raise InputError(f"--run: {source} is one run, not a study")
        require_ros("view of a recording")
        from isogal.scenario import load_scenario
        from isogal_ros.bags.viewing import open_bag

        told = None if scenario is None else load_scenario(scenario)
        return open_bag(bag, told, topics.remap, topics.driver)
    if scenario is not None or topics.remap or topics.driver:
        raise InputError(
            "--scenario, --remap, --driver: are for recordings; a study holds its own"
        )
    if not (source / "results.json").is_file():
        raise InputError(
            f"{source}: neither a recording (MCAP) nor the folder of a run (bag) or of a study"
            " (results.json)"
        )
    from isogal.montecarlo.viewing import open_study

    return open_study(source, run)


@with_groups
def compare(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN RUN ...", help="Folders of runs or studies, or their JSON files."
        ),
    ],
    out: Annotated[
        Path | None, written_folder("Folder for report.html and the figure of errors over time.")
    ] = None,
    json: Json = False,
) -> None:
    """Put runs or studies side by side: what differs in their scenarios, their figures of merit,
    and with --out their errors over time in one figure."""
    from isogal.evaluation.comparison import comparison, read_results, rows_of, write_comparison

    for source in sources:
        if out is not None and out.resolve() == source.resolve():
            raise InputError(f"--out {out}: is one of those compared, whose report would be lost")
    results = read_results(sources)
    found = comparison(results)
    if json:
        print_json({"runs": list(results), **found})
    else:
        print_table(("", *results), [row for part in rows_of(found) for row in part])
    if out is not None:
        page = write_comparison(out, results)
        typer.echo(str(page), err=json)
