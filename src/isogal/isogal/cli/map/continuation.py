"""``isogal map continue``: a map at another height."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from isogal.cli.checks import finite, not_negative, positive
from isogal.cli.map.part import PartChoice, whole_window
from isogal.cli.map.results import NetcdfOut, say_written
from isogal.cli.map_choice import MapChoice
from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.axes import Window
    from isogal.maps.field_map import FieldMap


@dataclass(frozen=True)
class Heights:
    """From where a map is continued, and to which level."""

    PANEL: ClassVar[str] = "Heights"

    height: Annotated[
        float,
        typer.Option(
            metavar="M", callback=finite, help="Level to continue to, above the ellipsoid."
        ),
    ]
    from_height: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            callback=finite,
            help="Level that the values hold on; default: as the map says.",
        ),
    ] = None
    terrain: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Map of the ground's height, for values on the ground (GGMplus)."
        ),
    ] = None
    downward_cutoff: Annotated[
        float | None,
        typer.Option(
            metavar="KM",
            callback=positive,
            help="Leave out wavelengths shorter than this; needed downwards.",
        ),
    ] = None
    edge: Annotated[
        float | None,
        typer.Option(
            metavar="KM",
            callback=not_negative,
            help="Rim that is left out; default: five times the way up or down.",
        ),
    ] = None

    def check(self) -> None:
        """Raise InputError where options do not go together."""
        for name, value in (
            ("--from-height", self.from_height),
            ("--downward-cutoff", self.downward_cutoff),
        ):
            if self.terrain is not None and value is not None:
                raise InputError(f"{name} {value:g}: cannot be given together with --terrain")

    def continued(self, field_map: "FieldMap", window: "Window | None") -> "FieldMap":
        """Return a map on the level; of the terrain only a window is read. Raises InputError."""
        from isogal.maps.continuation.level import to_level
        from isogal.maps.continuation.terrain import from_terrain
        from isogal.maps.load import load_map

        edge = None if self.edge is None else 1e3 * self.edge
        if self.terrain is not None:
            ground = load_map(self.terrain, quantity="height", window=window)
            return from_terrain(field_map, ground, self.height, edge=edge)
        cutoff = None if self.downward_cutoff is None else 1e3 * self.downward_cutoff
        return to_level(field_map, self.height, self.from_height, cutoff=cutoff, edge=edge)


@with_groups
def continue_(
    map_: MapChoice, out: NetcdfOut, heights: Heights, where: PartChoice, json: Json = False
) -> None:
    """Continue a map of gravity disturbances, magnetic anomalies or gradients to another height,
    and write it as NetCDF that says its height and its error there.

    From a level to a level, or with --terrain from the ground. Downwards only with
    --downward-cutoff."""
    from isogal.maps.formats.netcdf_writing import write_netcdf

    heights.check()
    part = where.part(where.build_if_asked())
    whole = None if part is None else whole_window(part)
    field_map = heights.continued(map_.load(whole, "disturbance"), whole)
    write_netcdf(field_map, out)
    say_written(field_map, out, json)
