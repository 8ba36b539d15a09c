"""How the commands of ``isogal map`` print a result, and where they write a picture."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isogal.cli.checks import output_file
from isogal.cli.options import RESULTS
from isogal.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _png(path: Path | None) -> Path | None:
    """Return a file's name; raises InputError where a picture cannot be written to it."""
    if path is not None and path.suffix.casefold() != ".png":
        raise InputError(f"--figure {path}: must end in .png")
    return output_file(path)


Picture = Annotated[
    Path | None,
    typer.Option(
        "--figure",
        metavar="FILE.png",
        help="Draw a picture.",
        rich_help_panel=RESULTS,
        callback=_png,
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


def say_written(found: dict[str, Any], path: Path, as_json: bool) -> None:
    """Print the description of a map that was written, and where it is."""
    from isogal.cli.map.description import print_map

    if as_json:
        print_json(found | {"file": str(path)})
    else:
        print_map(found)
        typer.echo(str(path))
