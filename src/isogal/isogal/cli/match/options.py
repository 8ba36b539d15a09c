"""Options of ``isogal match``, by subject."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from isogal.cli.checks import not_negative, positive
from isogal.cli.options import RESULTS, Json
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.tracks.matching import Match, Uncertainty

ASSUMED = "What is assumed"


@dataclass(frozen=True)
class TrackChoice:
    """Which recorded track, and what its file does not say."""

    track: Annotated[
        Path,
        typer.Option(
            "--track",
            metavar="FILE",
            help=(
                "CSV file with the columns time (s), latitude, longitude (deg, where the navigator"
                " said it was), value,"
                " and if you like sigma and offset (added to the map's value); or a bag (MCAP)."
            ),
        ),
    ]
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


@dataclass(frozen=True)
class MatcherChoice:
    """Which matcher, with which batches."""

    matcher: Annotated[
        str | None,
        typer.Option("--matcher", metavar="NAME", help="Matching algorithm; default: pmht."),
    ] = None
    batch_length: Annotated[
        int | None,
        typer.Option("--batch-length", metavar="T", help="Readings matched at once; default: 30."),
    ] = None
    stride: Annotated[
        int | None,
        typer.Option("--stride", help="Readings between fixes; default: the batch length."),
    ] = None
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Any key matcher.*, e.g. matcher.options.samples=4096; repeatable.",
        ),
    ] = None
    chain: Annotated[
        bool,
        typer.Option(
            "--chain",
            help="Each batch starts from what the earlier ones told, as an aided navigator would.",
        ),
    ] = False

    def check(self) -> None:
        """Raise InputError unless the keys and their values are allowed."""
        from isogal.scenario import load_scenario

        load_scenario(None, self.changes())

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
        named = {"name": self.matcher, "batch_length": self.batch_length, "stride": self.stride}
        return items + [f"matcher.{key}={x}" for key, x in named.items() if x is not None]


@dataclass(frozen=True)
class Assumptions:
    """How wrong track, readings and map are; sigmas of readings and map in the track's unit."""

    prior_sigma: Annotated[
        float,
        typer.Option(
            "--prior-sigma",
            metavar="M",
            help="1-sigma of the track's position, m per axis.",
            rich_help_panel=ASSUMED,
        ),
    ] = 1000.0
    velocity_sigma: Annotated[
        float,
        typer.Option(
            "--velocity-sigma",
            metavar="M/S",
            help="1-sigma of the track's velocity, constant over a batch, m/s per axis.",
            rich_help_panel=ASSUMED,
        ),
    ] = 0.0
    walk_sigma: Annotated[
        float,
        typer.Option(
            "--walk-sigma",
            metavar="M",
            help="With --chain: how far the track's error walks between batches, m in an hour.",
            rich_help_panel=ASSUMED,
        ),
    ] = 0.0
    sensor_sigma: Annotated[
        float | None,
        typer.Option(
            "--sensor-sigma",
            callback=positive,
            help=(
                "1-sigma of a reading, where the track has no column sigma; default for gravity: 1"
                " mGal."
            ),
            rich_help_panel=ASSUMED,
        ),
    ] = None
    map_sigma: Annotated[
        str | None,
        typer.Option(
            "--map-sigma",
            help=(
                "1-sigma of the map's error, or auto; default: what the map says (it counts where"
                " it is larger), else 0."
            ),
            rich_help_panel=ASSUMED,
        ),
    ] = None
    map_correlation_length: Annotated[
        float | None,
        typer.Option(
            "--map-correlation-length",
            metavar="M",
            help="Its correlation length, m; default: what the map says, else 4000.",
            rich_help_panel=ASSUMED,
        ),
    ] = None
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help=(
                "Track like --track (CSV), near by and with true positions: the map's error is"
                " learnt from it; repeatable."
            ),
            rich_help_panel=ASSUMED,
        ),
    ] = None
    bias_sigma: Annotated[
        float | None,
        typer.Option(
            "--bias-sigma",
            callback=not_negative,
            help="1-sigma of an unknown constant in the readings; default: 0.",
            rich_help_panel=ASSUMED,
        ),
    ] = None

    def of_track(self) -> "Uncertainty":
        """Return how wrong the track's positions are; raises InputError."""
        from isogal.tracks.matching import Uncertainty

        return Uncertainty(self.prior_sigma, self.velocity_sigma, self.walk_sigma)

    def map_changes(self, factor: float) -> list[str]:
        """Return what the options say of the map's and the readings' errors as keys of the
        scenario.

        Parameters
        ----------
        factor : float
            Units inside in one unit of the track.

        Raises
        ------
        InputError
            ``--map-sigma`` is neither a number nor ``auto``.
        """
        items = []
        if self.map_sigma is not None:
            items.append(f"matcher.map_sigma={_scaled(self.map_sigma, factor)}")
        if self.map_correlation_length is not None:
            items.append(f"matcher.map_correlation_length={self.map_correlation_length!r}")
        if self.bias_sigma is not None:
            items.append(f"matcher.bias_sigma={self.bias_sigma * factor!r}")
        return items


def _scaled(map_sigma: str, factor: float) -> str:
    if map_sigma == "auto":
        return map_sigma
    try:
        return repr(float(map_sigma) * factor)
    except ValueError:
        raise InputError(f"--map-sigma: must be a number or auto, not '{map_sigma}'") from None


@dataclass(frozen=True)
class MatchResults:
    """What becomes of the results."""

    out: Annotated[
        list[Path] | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Results, by suffix: .json, .csv or .geojson; repeatable.",
            rich_help_panel=RESULTS,
        ),
    ] = None
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            metavar="DIR",
            help="Folder for a report with figures.",
            rich_help_panel=RESULTS,
        ),
    ] = None
    json: Json = False

    def check(self) -> None:
        """Raise InputError unless every file's suffix is known."""
        from isogal.tracks.results import writer_for

        for path in self.out or ():
            writer_for(path)

    def write(self, matches: "Sequence[Match]", chained: bool) -> None:
        """Write the files; raises InputError."""
        from isogal.tracks.results import as_objects, write_results

        for path in self.out or ():
            write_results(as_objects(matches, chained), path)

    def show(self, matches: "Sequence[Match]", chained: bool) -> None:
        """Print the fixes."""
        from isogal.cli.match.table import print_table
        from isogal.tracks.results import as_json, as_objects

        if self.json:
            typer.echo(as_json(as_objects(matches, chained)), nl=False)
        else:
            print_table(matches)
