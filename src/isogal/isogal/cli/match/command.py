"""The command ``isogal match``, from the options to the results."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import typer

from isogal.cli.map_choice import MapOption
from isogal.cli.match.inputs import read_fields
from isogal.cli.match.options import (
    Assumptions,
    MatcherChoice,
    MatchResults,
    TrackChoice,
    check_together,
)
from isogal.cli.option_groups import with_groups
from isogal.cli.tables import print_table

if TYPE_CHECKING:
    from isogal.tracks.fields import TrackField
    from isogal.tracks.matching import Match, Uncertainty


@with_groups
def match(
    map_: MapOption,
    track: TrackChoice,
    matching: MatcherChoice,
    assumed: Assumptions,
    results: MatchResults,
) -> None:
    """Match a recorded track of any scalar field against a map: a fix for every batch of readings.

    The fixes and their covariances are those of the measurements alone.
    """
    from isogal.tracks.matching import Uncertainty
    from isogal.tracks.results import HEADER, as_json, as_objects, cells, in_words, write_results

    check_together(track, matching, assumed, results)
    uncertainty = Uncertainty(assumed.prior_sigma, assumed.velocity_sigma, assumed.walk_sigma)
    lines = read_fields(map_, track.resolved(), assumed, matching)
    found = [(_matched(fields, uncertainty, matching.chain, results), fields) for fields in lines]
    objects = [entry for one in found for entry in as_objects(*one)]
    for path in results.out or ():
        write_results(objects, path)
    if results.json:
        typer.echo(as_json(objects), nl=False)
        return
    for matches, fields in found:
        rows, line = [cells(match.fix) for match in matches], fields[0].track.line
        title = None if line is None else f"line {line}"
        print_table(HEADER, rows, *in_words(matches, fields), title=title, words=(4,))


def _matched(
    fields: "Sequence[TrackField]",
    uncertainty: "Uncertainty",
    chained: bool,
    results: MatchResults,
) -> "list[Match]":
    """Match a track, or a line of its file, showing how far it is on a terminal, and write its
    report; raises InputError."""
    from isogal.cli.progress import Bars
    from isogal.tracks.match_report import write_match_report
    from isogal.tracks.matching import match_fields

    line = fields[0].track.line
    name = "batches" if line is None else f"line {line}"
    with Bars("batches") as bars:
        bars(name, 0, 1)
        progress = partial(bars, name)
        matches = match_fields(fields, uncertainty, chained=chained, progress=progress)
    if results.report is not None:
        folder = results.report if line is None else results.report / f"line_{line}"
        write_match_report(fields, uncertainty, matches, folder)
    return matches
