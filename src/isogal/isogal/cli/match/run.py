"""One track of ``isogal match``, from what was read to its fixes and report."""

from typing import TYPE_CHECKING

from isogal.cli.match.inputs import Inputs
from isogal.cli.match.options import Assumptions, Matched, MatcherChoice, MatchResults
from isogal.cli.match.settings import matcher_settings
from isogal.cli.progress import Bars

if TYPE_CHECKING:
    from isogal.tracks.matching import Uncertainty


def match_and_report(
    inputs: Inputs,
    matching: MatcherChoice,
    assumed: Assumptions,
    uncertainty: "Uncertainty",
    results: MatchResults,
    reduction: str | None,
) -> Matched:
    """Match a track, showing how far it is on a terminal, and write its report.

    Raises
    ------
    InputError
        What the options say is not allowed, or the report cannot be written.
    """
    from isogal.tracks.match_report import write_match_report
    from isogal.tracks.matching import match_track

    settings = matcher_settings(matching, assumed, inputs, reduction)
    track, field_map, chained = inputs.track, inputs.field_map, matching.chain
    name = "batches" if inputs.line is None else f"line {inputs.line}"
    with Bars("batches") as bars:
        bars(name, 0, 1)
        matches = match_track(
            track,
            field_map,
            settings,
            uncertainty,
            chained=chained,
            progress=lambda done, total: bars(name, done, total),
        )
    if results.report is not None:
        folder = results.report if inputs.line is None else results.report / f"line_{inputs.line}"
        write_match_report(
            track, field_map, settings, uncertainty, matches, folder, chained=chained
        )
    return Matched(matches, inputs.line, inputs.factor)
