"""Options of ``isogal match``, by subject."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isogal.cli.checks import output_file, output_folder
from isogal.cli.options import RESULTS, Json
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.tiled_map import ScalarMap
    from isogal.tracks.matching import Match, Uncertainty

ASSUMED = "What is assumed"


@dataclass(frozen=True)
class MatcherChoice:
    """Which matcher, with which batches."""

    matcher: Annotated[
        str | None,
        typer.Option("--matcher", metavar="NAME", help="Matching algorithm; default: pmht."),
    ] = None
    batch_length: Annotated[
        str | None,
        typer.Option(
            "--batch-length",
            metavar="T|all",
            help="Readings matched at once, or all of a track; default: 30.",
        ),
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
            help="Any key matcher.*, e.g. matcher.options.trust=3; repeatable.",
        ),
    ] = None
    chain: Annotated[
        bool,
        typer.Option(
            "--chain",
            help="Each batch starts from what the earlier ones told, as an aided navigator would.",
        ),
    ] = False

    @property
    def whole(self) -> bool:
        """Whether a track is matched as one batch."""
        return self.batch_length is not None and self.batch_length.casefold() == "all"

    def check(self) -> None:
        """Raise InputError unless the keys and their values are allowed."""
        from isogal.scenario import load_scenario

        try:
            load_scenario(None, self.changes())
        except InputError as error:
            raise InputError(str(error).removeprefix("scenario: ")) from None

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
        str | None,
        typer.Option(
            "--sensor-sigma",
            metavar="SIGMA",
            help=(
                "1-sigma of a reading, where the track has no column sigma, such as 0.5mGal;"
                " default: what --reference shows, for gravity 1 mGal."
            ),
            rich_help_panel=ASSUMED,
        ),
    ] = None
    map_sigma: Annotated[
        str | None,
        typer.Option(
            "--map-sigma",
            metavar="SIGMA|auto",
            help=(
                "1-sigma of the map's error, such as 15nT, or auto: estimated; default: what the"
                " map says (it counts where it is larger), else auto."
            ),
            rich_help_panel=ASSUMED,
        ),
    ] = None
    map_correlation_length: Annotated[
        float | None,
        typer.Option(
            "--map-correlation-length",
            metavar="M",
            help="Its correlation length, m; default: what the map says, else estimated.",
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
        str | None,
        typer.Option(
            "--bias-sigma",
            metavar="SIGMA",
            help="1-sigma of an unknown constant in the readings; default: estimated.",
            rich_help_panel=ASSUMED,
        ),
    ] = None

    def of_track(self, chained: bool) -> "Uncertainty":
        """Return how wrong the track's positions are; raises InputError."""
        from isogal.tracks.matching import Uncertainty

        if self.walk_sigma and not chained:
            raise InputError(f"--walk-sigma {self.walk_sigma:g}: goes with --chain")
        return Uncertainty(self.prior_sigma, self.velocity_sigma, self.walk_sigma)

    def map_changes(self, field_map: "ScalarMap", factor: float) -> list[str]:
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
        from isogal.cli.match.sigmas import parse_sigma

        items = []
        if self.map_sigma == "auto":
            items.append("matcher.map_sigma=auto")
        elif self.map_sigma is not None:
            sigma = parse_sigma(self.map_sigma, "--map-sigma", field_map, factor)
            items.append(f"matcher.map_sigma={sigma!r}")
        if self.map_correlation_length is not None:
            items.append(f"matcher.map_correlation_length={self.map_correlation_length!r}")
        if self.bias_sigma is not None:
            sigma = parse_sigma(self.bias_sigma, "--bias-sigma", field_map, factor)
            items.append(f"matcher.bias_sigma={sigma!r}")
        return items

    def reading_sigma(self, field_map: "ScalarMap", factor: float) -> float | None:
        """Return ``--sensor-sigma`` in the unit inside; raises InputError."""
        from isogal.cli.match.sigmas import parse_sigma

        if self.sensor_sigma is None:
            return None
        return parse_sigma(self.sensor_sigma, "--sensor-sigma", field_map, factor, zero=False)


@dataclass(frozen=True)
class MatchResults:
    """What becomes of the results."""

    out: Annotated[
        list[Path] | None,
        typer.Option(
            "--out",
            metavar="FILE",
            callback=output_file,
            help="Results, by suffix: .json, .csv or .geojson; repeatable.",
            rich_help_panel=RESULTS,
        ),
    ] = None
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            metavar="DIR",
            callback=output_folder,
            help="Folder for a report with figures.",
            rich_help_panel=RESULTS,
        ),
    ] = None
    json: Json = False

    def check(self, gradients: bool) -> None:
        """Raise InputError unless every file's suffix is known, and a report can show what was
        read."""
        from isogal.tracks.results import writer_for

        if gradients and self.report is not None:
            raise InputError("--report: shows tracks of one number per reading, not --gradients")
        for path in self.out or ():
            writer_for(path)

    def write(self, found: "Sequence[Matched]", chained: bool) -> None:
        """Write the files; raises InputError."""
        from isogal.tracks.results import write_results

        for path in self.out or ():
            write_results(_objects(found, chained), path)

    def show(self, found: "Sequence[Matched]", chained: bool) -> None:
        """Print the fixes."""
        from isogal.cli.match.table import print_table
        from isogal.tracks.results import as_json

        if self.json:
            typer.echo(as_json(_objects(found, chained)), nl=False)
            return
        for one in found:
            print_table(one.matches, one.line)


def _objects(found: "Sequence[Matched]", chained: bool) -> list[dict[str, Any]]:
    from isogal.tracks.results import as_objects

    return [
        entry
        for one in found
        for entry in as_objects(
            one.matches, chained, factor=one.factor, line=one.line, others=one.others
        )
    ]


@dataclass(frozen=True)
class Matched:
    """What a track, or a line of its file, has given."""

    matches: "Sequence[Match]"
    line: str | None
    factor: float
    """Units inside in one unit of the track."""
    others: "Mapping[str, float]"
    """The same of each other field, by its name."""
