"""Options of ``isogal match``: the recorded track, the matcher, what is assumed of errors, and
what becomes of the results."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from isogal.cli.checks import positive
from isogal.cli.options import RESULTS, Json, flag, number, text, written_file, written_folder
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.tiled_map import ScalarMap


@dataclass(frozen=True)
class TrackChoice:
    """Which recorded track, and what its file does not say."""

    track: Annotated[
        Path,
        text(
            "FILE",
            "CSV or XYZ file with the columns latitude, longitude (deg, where the navigator said"
            " it was; or x, y with --crs), value, and if you like time (s or ISO 8601), sigma,"
            " offset (added to the map's value) and line; or a bag (MCAP).",
        ),
    ]
    column: Annotated[
        str | None,
        text(
            "NAME",
            "Column of the readings; default: value. With another NAME the columns NAME_sigma and"
            " NAME_offset go with it.",
        ),
    ] = None
    gradients: Annotated[
        str | None,
        text(
            "nn,ne,nd,ee,ed",
            "The readings are these components of the gravity gradient tensor (n north, e east, d"
            " down; less the normal gradient), in columns of these names, t_nn or tnn, in E; the"
            " map is of the disturbance.",
        ),
    ] = None
    one_potential: Annotated[
        bool,
        flag(
            "--one-potential",
            "Errors of the components' maps come from one wrong potential: --map-sigma and"
            " --map-correlation-length are those of dd; goes with --gradients. Without it they"
            " count as independent.",
        ),
    ] = False
    tilt_sigma: Annotated[
        float,
        number(
            "1-sigma of the tilt of the gradiometer's platform, which is estimated where"
            " there are several components; 0 = it is level; goes with --gradients.",
            "RAD",
            least=0.0,
            most=0.1,
        ),
    ] = 5e-3
    offset_sigma: Annotated[
        float,
        number("1-sigma of each component's offset, E; goes with --gradients.", "E", least=0),
    ] = 0.0
    offset_walk: Annotated[
        float,
        number("By how much that walks, E per root second; goes with --gradients.", "E", least=0),
    ] = 0.0
    also: Annotated[
        list[str] | None,
        text(
            "KEY=VALUE,...",
            "Another field that was read along the track: map=FILE,column=NAME and, where needed,"
            " variable, quantity, unit, crs, format, track-unit, reduction, height, map-height,"
            " sensor-sigma, map-sigma, map-correlation-length, bias-sigma, as the options of these"
            " names; repeatable.",
        ),
    ] = None
    track_unit: Annotated[
        str | None,
        text(
            "UNIT",
            "Unit of value, sigma and offset and of the sigma options below; default: that of"
            " their header, as value[mGal], else the map file's.",
        ),
    ] = None
    reduction: Annotated[
        str | None,
        text(
            "none|latitude|velocity|main-field",
            "What of the track itself went into value or offset: normal gravity at its latitude,"
            " or also the Eötvös acceleration of its velocity, or the Earth's main magnetic field"
            " at its position. A candidate elsewhere would have had another. Default: none, but an"
            " offset that holds normal gravity is allowed to be that of another latitude. Of a"
            " bag's readings it is known.",
        ),
    ] = None
    fix_topic: Annotated[
        str | None, text("TOPIC", "Of a bag: the navigator's position; default: nav/fix.")
    ] = None
    compensation: Annotated[
        Path | None,
        text(
            "FILE.yaml",
            "Coefficients of isogal mag calibrate: the track is a flight of isogal mag with the"
            " columns scalar, vector_x, vector_y, vector_z (nT) and height (m); the vehicle's"
            " field and the main field are taken off.",
        ),
    ] = None
    base: Annotated[
        Path | None,
        text(
            "FILE.csv",
            "Base station near by, with the columns time (on the track's clock) and scalar (nT):"
            " the daily variation that it measured is taken off the track's values.",
        ),
    ] = None
    height: Annotated[
        float | None,
        number(
            "Height of the readings above the ellipsoid: the map is continued there from the level"
            " that it says its values hold on. Default: it is taken as it is.",
            "M",
        ),
    ] = None
    map_height: Annotated[
        float | None,
        number(
            "With --height: the level that the map's values hold on; default: as it says.", "M"
        ),
    ] = None
    spacing: Annotated[
        float | None, number("Average readings over stretches of this length, m.", "M", positive)
    ] = None

    def resolved(self) -> "TrackChoice":
        """Return the same with what a compensation or a base station says of the track's values;
        raises InputError where they are in another unit than a base station's."""
        if self.base is not None and self.track_unit not in (None, "nT"):
            raise InputError(f"--base: is in nT, --track-unit is {self.track_unit}")
        if self.compensation is None and self.base is None:
            return self
        reduction = "main-field" if self.compensation is not None else None
        unit = self.track_unit or "nT"
        return replace(self, reduction=self.reduction or reduction, track_unit=unit)


@dataclass(frozen=True)
class MatcherChoice:
    """Which matcher, with which batches."""

    matcher: Annotated[str | None, text("NAME", "Matching algorithm; default: pmht.")] = None
    batch_length: Annotated[
        str | None, text("T|all", "Readings matched at once, or all of a track; default: 30.")
    ] = None
    stride: Annotated[int | None, number("Readings between fixes; default: the batch length.")] = (
        None
    )
    set_: Annotated[
        list[str] | None,
        text("KEY=VALUE", "Any key matcher.*, e.g. matcher.options.trust=3; repeatable.", "--set"),
    ] = None
    chain: Annotated[
        bool,
        flag(
            "--chain",
            "Each batch starts from what the earlier ones say, as an aided navigator would.",
        ),
    ] = False

    @property
    def whole(self) -> bool:
        """Whether a track is matched as one batch."""
        return self.batch_length is not None and self.batch_length.casefold() == "all"

    def changes(self) -> list[str]:
        """Return the keys of the scenario's section `matcher` that the options change, as
        ``KEY=VALUE``.

        Raises
        ------
        InputError
            ``--set`` names a key of another section.
        """
        items = list(self.set_ or ())
        for item in items:
            if not item.startswith("matcher."):
                raise InputError(f"--set {item}: only keys that begin with matcher. count here")
        length = None if self.whole else self.batch_length
        named = {"name": self.matcher, "batch_length": length, "stride": self.stride}
        return items + [f"matcher.{key}={x}" for key, x in named.items() if x is not None]


@dataclass(frozen=True)
class Assumptions:
    """How wrong track, readings and map are; sigmas of readings and map in the track's unit."""

    PANEL: ClassVar = "What is assumed"

    prior_sigma: Annotated[
        float, number("1-sigma of the track's position, m per axis.", "M", least=1e-3, most=1e6)
    ] = 1000.0
    velocity_sigma: Annotated[
        float,
        number(
            "1-sigma of the track's velocity, constant over a batch, m/s per axis.",
            "M/S",
            least=0.0,
            most=1e3,
        ),
    ] = 0.0
    walk_sigma: Annotated[
        float,
        number(
            "With --chain: how far the track's error walks between batches, m in an hour.",
            "M",
            least=0.0,
            most=1e6,
        ),
    ] = 0.0
    sensor_sigma: Annotated[
        str | None,
        text(
            "SIGMA",
            "1-sigma of a reading, where the track has no column sigma, such as 0.5mGal; default:"
            " what --reference shows, for gravity 1 mGal.",
        ),
    ] = None
    map_sigma: Annotated[
        str | None,
        text(
            "SIGMA|auto",
            "1-sigma of the map's error, such as 15nT, or auto: estimated; default: what the map"
            " says (it counts where it is larger), else auto.",
        ),
    ] = None
    map_correlation_length: Annotated[
        float | None,
        number("Its correlation length, m; default: what the map says, else estimated.", "M"),
    ] = None
    reference: Annotated[
        list[Path] | None,
        text(
            "FILE",
            "Track like --track (CSV), near by and with true positions: the map's error is learnt"
            " from it; repeatable.",
        ),
    ] = None
    bias_sigma: Annotated[
        str | None,
        text("SIGMA", "1-sigma of an unknown constant in the readings; default: estimated."),
    ] = None

    def changes(self, field_map: "ScalarMap", factor: float) -> list[str]:
        """Return what the options say of the map's and the readings' errors as keys of the
        scenario.

        Parameters
        ----------
        field_map : ScalarMap
        factor : float
            Units inside in one unit of the track.

        Raises
        ------
        InputError
            A sigma is neither a number (with the right unit) nor, of the map, ``auto``.
        """
        from isogal.cli.sigmas import parse_sigma

        sigma: str | float | None = self.map_sigma
        if sigma != "auto":
            sigma = parse_sigma(self.map_sigma, "--map-sigma", field_map, factor)
        named = {
            "map_sigma": sigma,
            "map_correlation_length": self.map_correlation_length,
            "bias_sigma": parse_sigma(self.bias_sigma, "--bias-sigma", field_map, factor),
        }
        return [f"matcher.{name}={value}" for name, value in named.items() if value is not None]

    def reading_sigma(self, field_map: "ScalarMap", factor: float) -> float | None:
        """Return ``--sensor-sigma`` in the unit inside; raises InputError."""
        from isogal.cli.sigmas import parse_sigma

        return parse_sigma(self.sensor_sigma, "--sensor-sigma", field_map, factor, zero=False)


@dataclass(frozen=True)
class MatchResults:
    """What becomes of the results."""

    PANEL: ClassVar = RESULTS

    out: Annotated[
        list[Path] | None,
        written_file(
            "FILE",
            "Results, by suffix: .json, .csv or .geojson; repeatable.",
            *(".json", ".csv", ".geojson"),
        ),
    ] = None
    report: Annotated[Path | None, written_folder("Folder for a report with figures.")] = None
    json: Json = False


_GOES_WITH = {
    "--one-potential": "--gradients",
    "--offset-sigma": "--gradients",
    "--offset-walk": "--gradients",
    "--map-height": "--height",
    "--walk-sigma": "--chain",
}
"""Options that mean nothing without another one."""
_NOT_OF_GRADIENTS = (
    *("--column", "--reference", "--spacing", "--reduction", "--compensation", "--base"),
    "--report",
)
"""Options that do not go with `--gradients`."""


def check_together(*groups: TrackChoice | MatcherChoice | Assumptions | MatchResults) -> None:
    """Raise InputError unless the options that are given go together; one is given where its value
    is not the default."""
    given = {
        f"--{option.name.replace('_', '-')}"
        for group in groups
        for option in fields(group)
        if getattr(group, option.name) != option.default
    }
    for option, other in _GOES_WITH.items():
        if option in given and other not in given:
            raise InputError(f"{option}: goes with {other}")
    for option in _NOT_OF_GRADIENTS:
        if "--gradients" in given and option in given:
            raise InputError(f"{option}: does not go with --gradients")
