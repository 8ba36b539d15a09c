"""Which map a command works on, and what its file does not say."""

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from isogal.cli.options import text
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.fields.source_map import MapSource
    from isogal.maps.axes import Window
    from isogal.maps.corridor import Corridor
    from isogal.maps.field_map import FieldMap
    from isogal.maps.tiled_map import ScalarMap
    from isogal.scenario import Settings

MAP = "Map"
"""Heading of the options that say what the map is."""
ARGUMENTS = "Arguments"
"""That of what is no option."""
SYNTHETIC = "synthetic"
"""Source that is no file."""
SOURCE_HELP = "NetCDF, GeoTIFF, ICGEM or XYZ file, GGMplus folder, or 'synthetic'."


@dataclass(frozen=True, kw_only=True)
class SourceOptions:
    """What a file of a map or a survey does not say."""

    PANEL: ClassVar[str] = MAP

    variable: Annotated[
        str | None, text("NAME", "Variable, band, column or extension of the values.")
    ] = None
    quantity: Annotated[
        str | None, typer.Option(help="What the values are of, where the file does not say.")
    ] = None
    unit: Annotated[
        str | None, typer.Option(help="Of the values, where the file does not say.")
    ] = None
    crs: Annotated[
        str | None, text("EPSG:N", "System of a GeoTIFF that does not say, or of columns x and y.")
    ] = None


@dataclass(frozen=True)
class MapChoice(SourceOptions):
    """Which map; by its file or folder, which is an argument."""

    source: Annotated[
        str, typer.Argument(metavar="MAP", help=SOURCE_HELP, rich_help_panel=ARGUMENTS)
    ]
    format_name: Annotated[
        str | None,
        text(
            "NAME", "Such as netcdf or xyz (a wrong one lists all); default: by name.", "--format"
        ),
    ] = None

    @property
    def is_synthetic(self) -> bool:
        """Whether the map is the synthetic one, which has no end."""
        return self.source == SYNTHETIC

    def load(self, window: "Window | None", measured: str = "gravity") -> "FieldMap":
        """Read the map.

        Parameters
        ----------
        window : Window, optional
            Only this part; the synthetic map needs it.
        measured : str
            Quantity of the synthetic map where the user names none.

        Raises
        ------
        InputError
            There is no such map, or it cannot be read.
        """
        if self.is_synthetic:
            if window is None:
                raise InputError(
                    "the synthetic map has no end: give --window, --route or --scenario"
                )
            return make_synthetic(self._synthetic_quantity(measured), window)
        return self._read(window)

    def given(self, settings: "Settings", measured: str) -> "MapSource":
        """Return the map as the source of a scenario's, which is continued to the height of the
        flight as in its runs."""
        from isogal.fields.source_map import MapSource

        named = {"source": self.source, "path": None, "variable": self.variable}
        if self.format_name is not None:
            named |= {"source": self.format_name, "path": self.source}
        read = partial(self.load, measured=measured)
        return MapSource(settings.map.model_copy(update=named), None, read)

    def load_part(
        self, part: "Window | Corridor | None", measured: str = "gravity"
    ) -> "ScalarMap":
        """Read the map, a window of it, or what lies along a route, in tiles if that is large;
        see `load`."""
        from isogal.cli.progress import Bars
        from isogal.maps.corridor import Corridor
        from isogal.maps.synthetic.synthetic_map import synthetic_map_along
        from isogal.maps.tiled_map import map_along

        if not isinstance(part, Corridor):
            return self.load(part, measured)
        if not self.is_synthetic:
            return map_along(self._read, part)
        with Bars("tiles") as bars:
            quantity = self._synthetic_quantity(measured)
            return synthetic_map_along(quantity, part, partial(bars, "tiles"))

    def _read(self, window: "Window | None") -> "FieldMap":
        from isogal.maps.load import load_map

        return load_map(
            self.source,
            self.variable,
            self.quantity,
            window,
            unit=self.unit,
            crs=self.crs,
            format_name=self.format_name,
        )

    def _synthetic_quantity(self, measured: str) -> str:
        from isogal.maps.synthetic.synthetic_map import quantity_of

        given = {"--unit": self.unit, "--crs": self.crs, "--format": self.format_name}
        for name, value in given.items():
            if value is not None:
                raise InputError(f"{name} {value}: cannot be given for the synthetic map")
        named = None if self.variable is None else quantity_of(self.variable, "--variable")
        return self.quantity or named or measured


def make_synthetic(quantity: str, window: "Window") -> "FieldMap":
    """Make the synthetic map of a quantity with a bar that shows how far it is; raises
    InputError."""
    from isogal.cli.progress import Bars
    from isogal.maps.synthetic.synthetic_map import synthetic_map

    with Bars("tiles") as bars:
        return synthetic_map(quantity, window, partial(bars, "tiles"))


@dataclass(frozen=True)
class MapOption(MapChoice):
    """Which map; by its file or folder, which is an option."""

    source: Annotated[str, text("FILE", SOURCE_HELP, "--map")]
