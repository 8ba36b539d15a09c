"""The command ``isogal match``."""

from isogal.cli.map_choice import MapOption
from isogal.cli.match.options import Assumptions, MatcherChoice, MatchResults
from isogal.cli.match.other_fields import all_fields
from isogal.cli.match.track_choice import TrackChoice
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
    from isogal.cli.match.run import match_and_report

    track = track.resolved()
    results.check(track.gradients is not None)
    matching.check()
    uncertainty = assumed.of_track(matching.chain)
    fields = all_fields(map_, track, assumed)
    found = [
        match_and_report(list(zip(fields, inputs, strict=True)), matching, uncertainty, results)
        for inputs in zip(*(field.read() for field in fields), strict=True)
    ]
    results.write(found, matching.chain)
    results.show(found, matching.chain)
