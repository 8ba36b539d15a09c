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
from isogal.cli.progress import Bars
from isogal.cli.tables import print_table

if TYPE_CHECKING:
    from isogal.matching.interfaces import Fix
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
    from isogal.tracks.results import as_json, as_objects, write_results

    check_together(track, matching, assumed, results)
    results.check()
    uncertainty = assumed.of_track()
    lines = read_fields(map_, track.resolved(), assumed, matching)
    found = [(_matched(fields, uncertainty, matching.chain, results), fields) for fields in lines]
    objects = [entry for one in found for entry in as_objects(*one, chained=matching.chain)]
    for path in results.out or ():
        write_results(objects, path)
    if results.json:
        typer.echo(as_json(objects), nl=False)
        return
    for one in found:
        _print(*one)


def _matched(
    fields: "Sequence[TrackField]",
    uncertainty: "Uncertainty",
    chained: bool,
    results: MatchResults,
) -> "list[Match]":
    """Match a track, or a line of its file, showing how far it is on a terminal, and write its
    report; raises InputError."""
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
        write_match_report(fields[0], uncertainty, matches, folder, chained=chained)
    return matches


def _print(matches: "Sequence[Match]", fields: "Sequence[TrackField]") -> None:
    """Print one row for each batch of a track (or of a line of its file), and how many of them
    gave a fix."""
    fixes, line = [match.fix for match in matches], fields[0].track.line
    published, failed = sum(f.published for f in fixes), sum(f.failed for f in fixes)
    words = f"; the matcher failed on {failed} of them" if failed else ""
    batches = _counted(len(fixes), "batch", "batches")
    below = [f"{_counted(published, 'fix', 'fixes')} of {batches}{words}"]
    below += _learnt(matches, fields)
    if published < len(fixes):
        below.append(
            "no fix: longer batches (--batch-length all), tracks with true positions near by"
            " (--reference), or --map-sigma auto where another was given may help"
        )
    header = ("time (s)", "latitude", "longitude", "1-sigma (m)", "")
    title = None if line is None else f"line {line}"
    print_table(header, [_cells(fix) for fix in fixes], *below, title=title, words=(4,))


def _counted(count: int, one: str, several: str) -> str:
    return f"{count} {one if count == 1 else several}"


def _learnt(matches: "Sequence[Match]", fields: "Sequence[TrackField]") -> list[str]:
    """Say what was learnt of the errors of map and readings: of several batches the median."""
    import numpy as np

    from isogal.tracks.results import estimated, found

    each = [entry for one in matches if (entry := found(one, fields))]
    if not each:
        return []
    lines, several = [], " (median of batches)" if len(each) > 1 else ""
    for field in fields:
        key = estimated(field, fields)
        if known := [list(entry[key].values()) for entry in each if key in entry]:
            sigma, length, offset, doubt = np.median(known, axis=0)
            of = "" if field is fields[0] else f" of {field.name}"
            lines.append(
                f"learnt{of}{several}: map error {sigma:.3g} {field.unit} over {length:.0f} m,"
                f" constant {offset:.3g} ± {doubt:.2g} {field.unit}"
            )
    used, out = (sum(entry[key] for entry in each) for key in ("readings", "readings_left_out"))
    misfit = np.median([entry["misfit"] for entry in each])
    lines.append(
        f"{used} readings used, {out} left out; squared residuals {misfit:.2f} of what is expected"
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
