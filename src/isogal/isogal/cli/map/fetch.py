"""``isogal map fetch``: GGMplus tiles from a mirror."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from isogal.cli.checks import finite
from isogal.cli.map.part import PartChoice
from isogal.cli.map.results import print_json
from isogal.cli.map_choice import MAP
from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json, written_folder
from isogal.cli.progress import Bars

if TYPE_CHECKING:
    from isogal.maps.ggmplus.download import Patience
    from isogal.maps.ggmplus.fetch import Fetched


@dataclass(frozen=True)
class Server:
    """Where the tiles come from, and how long it is tried."""

    base_url: Annotated[
        str,
        typer.Option(
            metavar="URL",
            help=(
                "Folder of a mirror that holds the folders ga, dg, ...:"
                " https://ddfe.curtin.edu.au/gravitymodels/GGMplus/data"
                " or https://ddfe.blazejbucha.com/models/GGMplus/data."
            ),
        ),
    ]
    timeout: Annotated[
        float,
        typer.Option(
            metavar="S",
            min=0.1,
            callback=finite,
            help="Seconds without a byte before another try.",
        ),
    ] = 30.0
    tries: Annotated[int, typer.Option(min=1, help="Tries in a row that bring nothing new.")] = 5

    def patience(self) -> "Patience":
        """Return how long it is tried."""
        from isogal.maps.ggmplus.download import Patience

        return Patience(self.timeout, self.tries)


@with_groups
def fetch(
    server: Server,
    where: PartChoice,
    out: Annotated[Path, written_folder("Folder of the tiles.")] = Path("ggmplus"),
    variable: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="ga, dg, xi, eta or ha; repeatable; default: by gravimeter.quantity.",
            rich_help_panel=MAP,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Fetch the GGMplus tiles that a route needs (default: the default route); go on where an
    earlier fetch broke off.

    The mirrors publish no checksums: a tile is trusted when it first arrives, its SHA-256 is kept
    in checksums.txt beside it, and a tile that differs from that later is refused."""
    from isogal.maps.ggmplus.fetch import fetch_tiles, tiles_for

    measured = "ga" if where.load().gravimeter.quantity == "gravity" else "dg"
    names = tiles_for(where.part_needed(), variable or [measured])
    with Bars("bytes") as bars:
        fetched = fetch_tiles(
            names, server.base_url, out, patience=server.patience(), progress=bars
        )
    if json:
        print_json(fetched.record())
    else:
        _print(names, fetched, out)


def _print(names: list[str], fetched: "Fetched", folder: Path) -> None:
    for name in names:
        if name in fetched.downloaded:
            state = "fetched"
        elif name in fetched.present:
            state = "there already"
        else:
            state = "not on the server (open sea?)"
        trusted = ", trusted on first use" if name in fetched.trusted else ""
        typer.echo(f"{name}  {state}{trusted}")
    typer.echo(f"map.source: {folder}")
