"""``isogal map fetch``: GGMplus tiles from a mirror."""

from pathlib import Path
from typing import Annotated

import typer

from isogal.cli.map.part import PartChoice
from isogal.cli.map_choice import MAP
from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json, number, text, written_folder
from isogal.cli.tables import print_result


@with_groups
def fetch(
    base_url: Annotated[
        str,
        text(
            "URL",
            "Folder of a mirror that holds the folders ga, dg, ...:"
            " https://ddfe.curtin.edu.au/gravitymodels/GGMplus/data"
            " or https://ddfe.blazejbucha.com/models/GGMplus/data.",
        ),
    ],
    where: PartChoice,
    timeout: Annotated[
        float, number("Seconds without a byte before another try.", "S", least=0.1)
    ] = 30.0,
    tries: Annotated[int, number("Tries in a row that bring nothing new.", least=1)] = 5,
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
    from isogal.cli.progress import Bars
    from isogal.maps.ggmplus.fetch import fetch_tiles, tiles_for

    measured = "ga" if where.load().gravimeter.quantity == "gravity" else "dg"
    names = tiles_for(where.part_needed(), variable or [measured])
    with Bars("bytes") as bars:
        fetched = fetch_tiles(names, base_url, out, timeout=timeout, tries=tries, progress=bars)
    lines = []
    for name in names:
        state = "not on the server (open sea?)"
        if name not in fetched.absent:
            state = "fetched" if name in fetched.downloaded else "there already"
        trusted = ", trusted on first use" if name in fetched.trusted else ""
        lines.append(f"{name}  {state}{trusted}")
    print_result(vars(fetched), json, *lines, f"map.source: {out}")
