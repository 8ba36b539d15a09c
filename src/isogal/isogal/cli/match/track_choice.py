"""Options of ``isogal match`` about the recorded track."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from isogal.cli.checks import finite
from isogal.errors import InputError


@dataclass(frozen=True)
class TrackChoice:
    """Which recorded track, and what its file does not say."""

    track: Annotated[
        Path,
        typer.Option(
            "--track",
            metavar="FILE",
            help=(
                "CSV or XYZ file with the columns latitude, longitude (deg, where the navigator"
                " said it was; or x, y with --crs), value, and if you like time (s or ISO 8601),"
                " sigma, offset (added to the map's value) and line; or a bag (MCAP)."
            ),
        ),
    ]
    column: Annotated[
        str | None,
        typer.Option(
            "--column",
            metavar="NAME",
            help=(
                "Column of the readings; default: value. With another NAME the columns NAME_sigma"
                " and NAME_offset go with it."
            ),
        ),
    ] = None
    gradients: Annotated[
        str | None,
        typer.Option(
            "--gradients",
            metavar="nn,ne,nd,ee,ed",
            help=(
                "The readings are these components of the gravity gradient tensor (n north, e"
                " east, d down; less the normal gradient), in columns of these names, t_nn or tnn,"
                " in E; the map is of the disturbance."
            ),
        ),
    ] = None
    one_potential: Annotated[
        bool,
        typer.Option(
            "--one-potential",
            help=(
                "Errors of the components' maps come from one wrong potential: --map-sigma and"
                " --map-correlation-length are those of dd; goes with --gradients. Without it they"
                " count as independent."
            ),
        ),
    ] = False
    tilt_sigma: Annotated[
        float,
        typer.Option(
            "--tilt-sigma",
            metavar="RAD",
            min=0.0,
            max=0.1,
            help=(
                "1-sigma of the tilt of the gradiometer's platform, which is estimated where there"
                " are several components; 0 = it is level; goes with --gradients."
            ),
        ),
    ] = 5e-3
    offset_sigma: Annotated[
        float,
        typer.Option(
            "--offset-sigma",
            metavar="E",
            min=0.0,
            help="1-sigma of each component's offset, E; goes with --gradients.",
        ),
    ] = 0.0
    offset_walk: Annotated[
        float,
        typer.Option(
            "--offset-walk",
            metavar="E",
            min=0.0,
            help="By how much that walks, E per root second; goes with --gradients.",
        ),
    ] = 0.0
    also: Annotated[
        list[str] | None,
        typer.Option(
            "--also",
            metavar="KEY=VALUE,...",
            help=(
                "Another field that was read along the track: map=FILE,column=NAME and, where"
                " needed, variable, quantity, unit, crs, format, track-unit, reduction, height,"
                " map-height, sensor-sigma, map-sigma, map-correlation-length, bias-sigma, as the"
                " options of these names; repeatable."
            ),
        ),
    ] = None
    track_unit: Annotated[
        str | None,
        typer.Option(
            "--track-unit",
            metavar="UNIT",
            help=(
                "Unit of value, sigma and offset and of the sigma options below; default: the map"
                " file's."
            ),
        ),
    ] = None
    reduction: Annotated[
        str | None,
        typer.Option(
            "--reduction",
            metavar="none|latitude|velocity|main-field",
            help=(
                "What of the track itself went into value or offset: normal gravity at its"
                " latitude, or also the Eötvös"
                " acceleration of its velocity, or the Earth's main magnetic field at its"
                " position. A candidate elsewhere would"
                " have had another. Default: none, but an offset that holds normal gravity is"
                " allowed to be that of another"
                " latitude. Of a bag's readings it is known."
            ),
        ),
    ] = None
    fix_topic: Annotated[
        str,
        typer.Option("--fix-topic", metavar="TOPIC", help="Of a bag: the navigator's position."),
    ] = "nav/fix"
    compensation: Annotated[
        Path | None,
        typer.Option(
            "--compensation",
            metavar="FILE.yaml",
            help=(
                "Coefficients of isogal mag calibrate: the track is a flight of isogal mag with"
                " the columns scalar, vector_x, vector_y, vector_z (nT) and height (m); the"
                " vehicle's field and the main field are taken off."
            ),
        ),
    ] = None
    base: Annotated[
        Path | None,
        typer.Option(
            "--base",
            metavar="FILE.csv",
            help=(
                "Base station near by, with the columns time (on the track's clock) and scalar"
                " (nT): the daily variation that it measured is taken off the track's values."
            ),
        ),
    ] = None
    height: Annotated[
        float | None,
        typer.Option(
            "--height",
            metavar="M",
            callback=finite,
            help=(
                "Height of the readings above the ellipsoid: the map is continued there from the"
                " level that it says its values hold on. Default: it is taken as it is."
            ),
        ),
    ] = None
    map_height: Annotated[
        float | None,
        typer.Option(
            "--map-height",
            metavar="M",
            callback=finite,
            help="With --height: the level that the map's values hold on; default: as it says.",
        ),
    ] = None
    spacing: Annotated[
        float | None,
        typer.Option(
            "--spacing",
            metavar="M",
            help="Average readings over stretches of this length, m.",
        ),
    ] = None

    def resolved(self) -> "TrackChoice":
        """Return the same with what a compensation or a base station says of the track's values;
        raises InputError where they are in another unit than a base station's, or options do not
        go together."""
        if self.gradients is not None and self.column is not None:
            raise InputError(f"--column {self.column}: --gradients names its own columns")
        if self.one_potential and self.gradients is None:
            raise InputError("--one-potential: goes with --gradients")
        if (self.offset_sigma or self.offset_walk) and self.gradients is None:
            raise InputError("--offset-sigma, --offset-walk: go with --gradients")
        if self.map_height is not None and self.height is None:
            raise InputError(f"--map-height {self.map_height:g}: goes with --height")
        if self.base is not None and self.track_unit not in (None, "nT"):
            raise InputError(f"--base: is in nT, --track-unit is {self.track_unit}")
        if self.compensation is None and self.base is None:
            return self
        reduction = "main-field" if self.compensation is not None else None
        unit = self.track_unit or "nT"
        return replace(self, reduction=self.reduction or reduction, track_unit=unit)
