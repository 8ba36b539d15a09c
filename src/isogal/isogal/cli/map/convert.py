"""``isogal map convert``: a map in another form."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from isogal.cli.checks import finite, positive
from isogal.cli.map.part import PartChoice, whole_window
from isogal.cli.map.results import require_netcdf_name, say_written
from isogal.cli.map_choice import ARGUMENTS, MapChoice
from isogal.cli.option_groups import with_groups
from isogal.cli.options import RESULTS, Json
from isogal.errors import InputError
from isogal.files import check_output

if TYPE_CHECKING:
    from isogal.maps.field_map import FieldMap


@dataclass(frozen=True)
class Target:
    """The file or folder that is written."""

    PANEL: ClassVar[str] = RESULTS

    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="NetCDF file to write; with --to ggmplus, a folder.",
            rich_help_panel=ARGUMENTS,
        ),
    ]
    to: Annotated[str, typer.Option(metavar="FORMAT", help="netcdf or ggmplus.")] = "netcdf"
    sigma: Annotated[
        float | None,
        typer.Option(
            min=0.0, callback=finite, help="1-sigma of the map's error to write into it, SI (nT)."
        ),
    ] = None
    correlation_length: Annotated[
        float | None, typer.Option(metavar="M", callback=positive, help="Of that error.")
    ] = None

    def check(self) -> None:
        """Raise InputError unless the name fits the format."""
        if self.to not in ("netcdf", "ggmplus"):
            raise InputError(f"--to {self.to}: must be netcdf or ggmplus")
        if self.to == "netcdf":
            require_netcdf_name(self.out, " (or give --to ggmplus)")
        check_output(self.out, folder=self.to == "ggmplus")

    def write(self, field_map: "FieldMap", variable: str | None) -> None:
        """Write a map; as this variable, where it can be the name of one. Raises InputError."""
        from isogal.maps.formats.netcdf_writing import write_netcdf
        from isogal.maps.ggmplus.writing import write_ggmplus

        if self.to == "netcdf":
            named = variable is not None and variable.isidentifier()
            write_netcdf(field_map, self.out, variable if named else None)
        else:
            write_ggmplus(field_map, self.out)

    def with_error(self, field_map: "FieldMap") -> "FieldMap":
        """Return the map with the error that the options name."""
        if self.sigma is not None:
            field_map = replace(field_map, sigma=self.sigma)
        if self.correlation_length is not None:
            field_map = replace(field_map, correlation_length=self.correlation_length)
        return field_map


@with_groups
def convert(map_: MapChoice, target: Target, where: PartChoice, json: Json = False) -> None:
    """Convert a map to NetCDF that says everything about itself, in SI units; whole, or the part
    of a route or window."""
    target.check()
    route = where.build_if_asked()
    part = where.part(route)
    whole = whole_window(part) if part is not None else None
    field_map = target.with_error(map_.load(whole, route.measured if route else "gravity"))
    target.write(field_map, map_.variable)
    say_written(field_map, target.out, json)
