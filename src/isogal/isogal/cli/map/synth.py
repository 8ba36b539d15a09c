"""``isogal map synth``: the synthetic map as a file."""

from pathlib import Path
from typing import Annotated

import typer

from isogal.cli.map.part import PartChoice, whole_window
from isogal.cli.map.results import netcdf_file, say_written
from isogal.cli.map_choice import MAP, make_synthetic
from isogal.cli.option_groups import with_groups
from isogal.cli.options import RESULTS, Json


@with_groups
def synth(
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE.nc", callback=netcdf_file, help="Map to write.", rich_help_panel=RESULTS
        ),
    ],
    where: PartChoice,
    quantity: Annotated[
        str, typer.Option(help="gravity, disturbance or height.", rich_help_panel=MAP)
    ] = "gravity",
    json: Json = False,
) -> None:
    """Write the synthetic map of a route or window as NetCDF; it is the same everywhere and
    always."""
    from isogal.maps.formats.netcdf_writing import write_netcdf

    field_map = make_synthetic(quantity, whole_window(where.part_needed()))
    write_netcdf(field_map, out)
    say_written(field_map, out, json)
