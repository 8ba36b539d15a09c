"""The command ``isogal match``."""

from isogal.cli.map_choice import MapOption
from isogal.cli.match.inputs import read_inputs
from isogal.cli.match.options import Assumptions, MatcherChoice, MatchResults, TrackChoice
from isogal.cli.match.settings import matcher_settings
from isogal.cli.option_groups import with_groups


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
    from isogal.tracks.matching import match_track

    results.check()
    matching.check()
    uncertainty = assumed.of_track()
    inputs = read_inputs(map_, track, assumed)
    settings = matcher_settings(matching, assumed, inputs, track.reduction)
    recorded, field_map, chained = inputs.track, inputs.field_map, matching.chain
    matches = match_track(recorded, field_map, settings, uncertainty, chained=chained)
    results.write(matches, chained)
    if results.report is not None:
        from isogal.tracks.match_report import write_match_report

        write_match_report(
            recorded, field_map, settings, uncertainty, matches, results.report, chained=chained
        )
    results.show(matches, chained)
