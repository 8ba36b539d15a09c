"""``isogal smooth``: the best track of a recorded voyage, afterwards."""

from pathlib import Path
from typing import Annotated

import typer

from isogal.cli.checks import finite
from isogal.cli.option_groups import with_groups
from isogal.cli.options import (
    Driver,
    FilterParameter,
    Json,
    Remap,
    ScenarioChoice,
    written_folder,
)
from isogal.errors import InputError


@with_groups
def smooth(
    chosen: ScenarioChoice,
    source: Annotated[
        Path,
        typer.Argument(metavar="BAG|RUN", help="Folder of a recording or run, or an MCAP file."),
    ],
    out: Annotated[
        Path, written_folder("Folder for smoothed.csv, .geojson, .gpx and a bag.")
    ] = Path("out/smooth"),
    interval: Annotated[
        float,
        typer.Option(
            metavar="S",
            min=0.0,
            callback=finite,
            help="Seconds between the rows of the files, at least; the bag has every state.",
        ),
    ] = 1.0,
    parameter: FilterParameter = None,
    remap: Remap = None,
    driver: Driver = None,
    json: Json = False,
) -> None:
    """Say of each moment of a recorded voyage where the vehicle was, by all data of the voyage:
    those that came later, too.

    The sensor messages are played to fresh nodes as by `isogal replay`. Where the truth was
    recorded, the errors are printed. The scenario is the recording's own; --scenario names
    another, --set changes keys."""
    bag = _bag_of(source)
    from isogal_ros.bags.remapping import Foreign
    from isogal_ros.graph.commands import Changes, smooth_command

    foreign = Foreign(remap or (), driver or ())
    changes = Changes(chosen.scenario, chosen.set_ or (), parameter or (), foreign)
    raise typer.Exit(smooth_command(bag, out, changes, interval=interval, json=json))


def _bag_of(source: Path) -> Path:
    """Return the recording of a run; raises InputError where there is none, or it cannot be
    read."""
    from isogal.cli.run import require_ros

    if not source.exists():
        raise InputError(f"{source}: no such recording or folder")
    bag = source / "bag" if (source / "bag").is_dir() else source
    if bag.is_dir() and (source / "results.json").is_file() and not any(bag.glob("*.mcap*")):
        raise InputError(
            f"{source}: is a study, which has no recording; isogal montecarlo --smooth smooths its"
            " runs"
        )
    require_ros("smooth")
    return bag
