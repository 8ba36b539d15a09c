"""``isogal smooth``: the best track of a recorded voyage, afterwards."""

from pathlib import Path
from typing import Annotated

import typer

from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json, number, written_folder
from isogal.cli.run import ReplayChoice, bag_of, require_ros
from isogal.errors import InputError


@with_groups
def smooth(
    chosen: ReplayChoice,
    source: Annotated[
        Path,
        typer.Argument(metavar="BAG|RUN", help="Folder of a recording or run, or an MCAP file."),
    ],
    out: Annotated[
        Path, written_folder("Folder for smoothed.csv, .geojson, .gpx and a bag.")
    ] = Path("out/smooth"),
    interval: Annotated[
        float,
        number(
            "Seconds between the rows of the files, at least; the bag has every state.",
            "S",
            least=0.0,
        ),
    ] = 1.0,
    json: Json = False,
) -> None:
    """Say of each moment of a recorded voyage where the vehicle was, by all data of the voyage:
    those that came later, too.

    The sensor messages are played to fresh nodes as by `isogal replay`. Where the truth was
    recorded, the errors are printed. The scenario is the recording's own; --scenario names
    another, --set changes keys."""
    bag = _recording(source)
    from isogal_ros.graph.commands import smooth_command

    raise typer.Exit(smooth_command(bag, out, chosen, interval=interval, json=json))


def _recording(source: Path) -> Path:
    """Return the recording of a run; raises InputError where there is none, or it cannot be
    read."""
    bag = bag_of(source)
    if bag.is_dir() and (source / "results.json").is_file() and not any(bag.glob("*.mcap*")):
        raise InputError(
            f"{source}: is a study, which has no recording; isogal montecarlo --smooth smooths its"
            " runs"
        )
    require_ros("smooth")
    return bag
