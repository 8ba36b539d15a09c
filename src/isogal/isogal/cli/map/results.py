"""How the commands of ``isogal map`` print a result, and where they write a picture."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isogal.cli.checks import output_file
from isogal.cli.options import RESULTS
from isogal.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from isogal.maps.field_map import FieldMap


def _png(path: Path | None) -> Path | None:
    """Return a file's name; raises InputError where a picture cannot be written to it."""
    if path is not None and path.suffix.casefold() != ".png":
        raise InputError(f"--figure {path}: must end in .png")
    return output_file(path)


Picture = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.png", help="Draw a picture.", rich_help_panel=RESULTS, callback=_png
    ),
]


def require_netcdf_name(path: Path, otherwise: str = "") -> None:
    """Raise InputError unless a file that is to be written has the name of a NetCDF file; the
    message ends with what else can be done."""
    if path.suffix.casefold() not in (".nc", ".nc4"):
        raise InputError(f"{path}: must end in .nc{otherwise}")


def draw(path: Path, figure: "Figure") -> None:
    """Write a figure as PNG file; raises InputError."""
    from isogal.evaluation.figures.style import png
    from isogal.files import write_atomic

    write_atomic(path, png(figure))


def print_json(found: dict[str, Any]) -> None:
    """Print a result as JSON."""
    typer.echo(json.dumps(found, indent=2, ensure_ascii=False, allow_nan=False))


def netcdf_file(path: Path) -> Path:
    """Return the name of a NetCDF file to be written; raises InputError where it has another
    suffix or cannot be."""
    require_netcdf_name(path)
    return output_file(path)


NetcdfOut = Annotated[
    Path, typer.Argument(metavar="OUT", callback=netcdf_file, help="NetCDF file to write.")
]


def say_written(
    field_map: "FieldMap", path: Path, as_json: bool, lines: Iterable[str] = (), **more: Any
) -> None:
    """Describe a map that was written: as JSON, with what else there is to say, or as a table with
    further lines; and where it is."""
    from isogal.cli.map.description import describe_map, print_map

    found = describe_map(field_map)
    if as_json:
        print_json(found | more | {"file": str(path)})
    else:
        print_map(found, *lines, str(path))
