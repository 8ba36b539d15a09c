"""The command ``isogal match``, from the options to the results."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import typer

from isogal.cli.errors import note
from isogal.cli.map_choice import MapOption
from isogal.cli.match.inputs import FieldChoice, Inputs, all_fields
from isogal.cli.match.options import (
    Assumptions,
    MatcherChoice,
    MatchResults,
    TrackChoice,
    check_together,
)
from isogal.cli.option_groups import with_groups
from isogal.cli.progress import Bars
from isogal.cli.tables import print_table

if TYPE_CHECKING:
    from isogal.matching.interfaces import Fix
    from isogal.scenario import Matcher
    from isogal.tracks.matching import Match, Uncertainty

_LENGTH = "matcher.map_correlation_length"


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
    check_together(track, matching, assumed, results)
    track = track.resolved()
    results.check()
    matching.check()
    uncertainty = assumed.of_track()
    fields = all_fields(map_, track, assumed)
    found = [
        _match_and_report(list(zip(fields, inputs, strict=True)), matching, uncertainty, results)
        for inputs in zip(*(field.read() for field in fields), strict=True)
    ]
    _write(found, matching.chain, results)


class _Matched(NamedTuple):
    """What a track, or a line of its file, has given."""

    matches: "Sequence[Match]"
    fields: "Mapping[str, Inputs]"
    """Readings of each field by its name; of the first by no name."""

    @property
    def line(self) -> str | None:
        """Of the track's file."""
        return self.fields[""].track.line

    @property
    def factors(self) -> dict[str, float]:
        """Units inside in one unit of each field."""
        return {name: read.factor for name, read in self.fields.items()}


def _match_and_report(
    fields: Sequence[tuple[FieldChoice, Inputs]],
    matching: MatcherChoice,
    uncertainty: "Uncertainty",
    results: MatchResults,
) -> _Matched:
    """Match a track, showing how far it is on a terminal, and write its report.

    Raises
    ------
    InputError
        What the options say is not allowed, or the report cannot be written.
    """
    from isogal.tracks.fields import TrackField
    from isogal.tracks.match_report import write_match_report
    from isogal.tracks.matching import match_fields

    inputs, chained = fields[0][1], matching.chain
    line = inputs.track.line
    settings = [
        matcher_settings(matching, field.assumed, read, field.track.reduction)
        for field, read in fields
    ]
    every = [
        TrackField(field.name, read.track, read.field_map, one, read.channels)
        for (field, read), one in zip(fields, settings, strict=True)
    ]
    name = "batches" if line is None else f"line {line}"
    with Bars("batches") as bars:
        bars(name, 0, 1)
        progress = partial(bars, name)
        matches = match_fields(every, uncertainty, chained=chained, progress=progress)
    if results.report is not None:
        folder = results.report if line is None else results.report / f"line_{line}"
        write_match_report(
            inputs.track,
            inputs.scalar_map,
            settings[0],
            uncertainty,
            matches,
            folder,
            chained=chained,
        )
    return _Matched(matches, {"": inputs} | {field.name: read for field, read in fields[1:]})


def matcher_settings(
    matching: MatcherChoice, assumed: Assumptions, inputs: Inputs, reduction: str | None
) -> "Matcher":
    """Return the scenario's section `matcher`; say on the standard error stream what is assumed
    that is not specified.

    Sigmas of the options are in the track's unit, those of ``--set`` in the unit inside.

    Raises
    ------
    InputError
        A key or a value is not allowed.
    """
    from isogal.scenario import load_scenario

    field_map = inputs.scalar_map
    changes = matching.changes() + assumed.map_changes(field_map, inputs.factor)
    given = {item.partition("=")[0] for item in changes}
    if _LENGTH not in given and field_map.correlation_length is not None:
        changes.append(f"{_LENGTH}={field_map.correlation_length!r}")
    settings = load_scenario(None, changes).matcher
    if "matcher.map_sigma" not in given and not field_map.states_error:
        note(
            "the map does not say how wrong it is, which is estimated along the track; give"
            " --map-sigma where it is known"
        )
    if matching.whole:
        length = max(len(inputs.track), 2)
        settings = settings.model_copy(update={"batch_length": length, "stride": None})
    if reduction is None:
        settings = _with_unknown_latitude(settings, inputs, assumed.prior_sigma)
    return settings


def _with_unknown_latitude(settings: "Matcher", inputs: Inputs, prior_sigma: float) -> "Matcher":
    """Return settings with an unknown constant, where the offset holds normal gravity and it is
    not specified at which latitude."""
    track = inputs.track
    change = track.normal_gravity_in_doubt(inputs.field_map.quantity) * prior_sigma
    if change == 0.0:
        return settings
    note(
        f"{track.where}: offset holds normal gravity; as it does not say at which latitude, an"
        f" unknown constant of {change / inputs.factor:.2g} {inputs.unit} is allowed for. Say"
        " --reduction latitude if it was the track's own, else --reduction none"
    )
    return settings.model_copy(update={"bias_sigma": math.hypot(settings.bias_sigma, change)})


def _write(found: "Sequence[_Matched]", chained: bool, results: MatchResults) -> None:
    """Write the files and print the fixes; raises InputError."""
    from isogal.tracks.results import as_json, as_objects, write_results

    objects = [
        entry
        for one in found
        for entry in as_objects(one.matches, chained, factors=one.factors, line=one.line)
    ]
    for path in results.out or ():
        write_results(objects, path)
    if results.json:
        typer.echo(as_json(objects), nl=False)
        return
    for one in found:
        _print(one)


def _print(matched: _Matched) -> None:
    """Print one row for each batch of a track (or of a line of its file), and how many of them
    gave a fix."""

    fixes = [match.fix for match in matched.matches]
    published, failed = sum(f.published for f in fixes), sum(f.failed for f in fixes)
    words = f"; the matcher failed on {failed} of them" if failed else ""
    batches = _counted(len(fixes), "batch", "batches")
    below = [f"{_counted(published, 'fix', 'fixes')} of {batches}{words}", *_learnt(matched)]
    if published < len(fixes):
        below.append(
            "no fix: longer batches (--batch-length all), tracks with true positions near by"
            " (--reference), or --map-sigma auto where another was given may help"
        )
    header = ("time (s)", "latitude", "longitude", "1-sigma (m)", "")
    title = None if matched.line is None else f"line {matched.line}"
    print_table(header, [_cells(fix) for fix in fixes], *below, title=title, words=(4,))


def _counted(count: int, one: str, several: str) -> str:
    return f"{count} {one if count == 1 else several}"


def _learnt(matched: _Matched) -> list[str]:
    """Say what was learnt of the errors of map and readings: of several batches the median."""
    import numpy as np

    from isogal.tracks.results import flat, found

    each = [
        {key: x for key, x in flat(entry).items() if isinstance(x, int | float)}
        for one in matched.matches
        if (entry := found(one, matched.factors))
    ]
    if not each:
        return []
    middle = {key: float(np.median([one[key] for one in each])) for key in each[0]}
    lines = []
    for name, read in matched.fields.items():
        prefix = f"{name}_estimated_" if name else "estimated_"
        if f"{prefix}map_sigma" in middle:
            sigma, length, offset, doubt = (
                middle[prefix + key]
                for key in ("map_sigma", "map_correlation_length", "offset", "offset_sigma")
            )
            lines.append(
                f"learnt{f' of {name}' if name else ''}{' (median of batches)' * (len(each) > 1)}:"
                f" map error {sigma:.3g} {read.unit} over {length:.0f} m, constant"
                f" {offset:.3g} ± {doubt:.2g} {read.unit}"
            )
    used, out = (sum(one[key] for one in each) for key in ("readings", "readings_left_out"))
    lines.append(
        f"{used:.0f} readings used, {out:.0f} left out; squared residuals {middle['misfit']:.2f}"
        " of what is expected"
    )
    return lines


def _cells(fix: "Fix") -> list[str]:
    import numpy as np

    time = f"{fix.time:.10g}"
    if not fix.published:
        return [time, "-", "-", "-", f"no fix: {fix.reason}"]
    short, long = np.sqrt(np.linalg.eigvalsh(fix.covariance))
    place = (f"{np.degrees(angle):.5f}" for angle in (fix.latitude, fix.longitude))
    return [time, *place, f"{long:.0f} x {short:.0f}", ""]
