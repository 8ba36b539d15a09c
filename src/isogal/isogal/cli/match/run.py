"""One track of ``isogal match``, from what was read to its fixes and report."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from isogal.cli.match.inputs import Inputs
from isogal.cli.match.options import Matched, MatcherChoice, MatchResults
from isogal.cli.match.other_fields import FieldChoice
from isogal.cli.match.settings import matcher_settings
from isogal.cli.progress import Bars

if TYPE_CHECKING:
    from isogal.scenario import Matcher
    from isogal.tracks.matching import Match, Uncertainty

Field = tuple[FieldChoice, Inputs]
"""What was said of a field, and what was read."""


def match_and_report(
    fields: Sequence[Field],
    matching: MatcherChoice,
    uncertainty: "Uncertainty",
    results: MatchResults,
) -> Matched:
    """Match a track, showing how far it is on a terminal, and write its report.

    Raises
    ------
    InputError
        What the options say is not allowed, or the report cannot be written.
    """
    from isogal.tracks.match_report import write_match_report

    inputs, chained = fields[0][1], matching.chain
    settings = [
        matcher_settings(matching, field.assumed, read, field.track.reduction)
        for field, read in fields
    ]
    name = "batches" if inputs.line is None else f"line {inputs.line}"
    with Bars("batches") as bars:
        bars(name, 0, 1)
        matches = _matches(
            fields, settings, uncertainty, chained, lambda done, total: bars(name, done, total)
        )
    if results.report is not None:
        folder = results.report if inputs.line is None else results.report / f"line_{inputs.line}"
        write_match_report(
            inputs.track,
            inputs.scalar_map,
            settings[0],
            uncertainty,
            matches,
            folder,
            chained=chained,
        )
    others = {field.name: read.factor for field, read in fields[1:]}
    return Matched(matches, inputs.line, inputs.factor, others)


def _matches(
    fields: Sequence[Field],
    settings: "Sequence[Matcher]",
    uncertainty: "Uncertainty",
    chained: bool,
    progress: Callable[[int, int], None],
) -> "list[Match]":
    from isogal.tracks.fields import TrackField
    from isogal.tracks.matching import match_fields

    every = [
        TrackField(field.name, read.track, read.field_map, one, read.channels)
        for (field, read), one in zip(fields, settings, strict=True)
    ]
    return match_fields(every, uncertainty, chained=chained, progress=progress)
