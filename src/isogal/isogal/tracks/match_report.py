"""The report of `isogal match`: the track on the map, its readings against the map, and a table of
the fixes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isogal.evaluation.html_report import Illustration, Section, Table, number, write_report
from isogal.tracks.fields import TrackField
from isogal.tracks.figures import readings_figure, shift_figure, track_map_figure
from isogal.tracks.matching import Match, Uncertainty
from isogal.tracks.results import HEADER, as_objects, cells, flat, in_words


def write_match_report(
    fields: Sequence[TrackField],
    uncertainty: Uncertainty,
    matches: Sequence[Match],
    out_dir: str | Path,
) -> Path:
    """Write `report.html` with PNG figures beside it; return the path of the page.

    Parameters
    ----------
    fields : sequence of TrackField
        Those that were matched; the figures are of the first, which has one channel.
    uncertainty : Uncertainty
        What was assumed of the track.
    matches : sequence of Match
    out_dir : path
    """
    field, length = fields[0], fields[0].settings.batch_length
    track, field_map = field.track, field.scalar_map
    start = "what the earlier ones told" if matches[0].chained else "the same prior"
    figures = [
        Illustration(
            "track",
            track_map_figure(track, field_map, matches),
            "The track as the navigator recorded it, and moved by what the fixes (and the prior)"
            " say, on the map.",
        ),
        Illustration(
            "readings",
            readings_figure(track, field_map, matches),
            "Readings (less their offset) and the map's values along the track as recorded and as"
            " matched; below, their differences.",
        ),
    ]
    if any(match.shifts is not None for match in matches):
        caption = (
            "Where the track may be: log posterior over its error, all noise models together; the"
            " ellipse is the fix's with the prior, 2-sigma, and + no error at all."
        )
        figures.append(Illustration("shifts", shift_figure(matches), caption))
    batches = f"Batches are of {length} readings, and each starts from {start}."
    result = Section(
        "Result", [batches, *in_words(matches, fields)], figures, _tables(matches, fields)
    )
    return write_report(
        out_dir,
        "Recorded track",
        [result, Section("What was assumed", tables=[_assumptions(field, uncertainty)])],
        subtitle=f"{Path(track.where).name} against {field_map.provenance}",
    )


def _tables(matches: Sequence[Match], fields: Sequence[TrackField]) -> list[Table]:
    """Return the fixes, and all that files of results say."""
    entries = [flat(entry) for entry in as_objects(matches, fields)]
    names = tuple(dict.fromkeys(name for entry in entries for name in entry))
    rows = [["–" if (x := one.get(n)) is None else str(x) for n in names] for one in entries]
    return [
        Table("Fixes, from the measurements alone", HEADER, [cells(one.fix) for one in matches]),
        Table("As in files of results", names, rows, folded=True),
    ]


def _assumptions(field: TrackField, uncertainty: Uncertainty) -> Table:
    settings, own = field.settings, np.asarray(field.scalar_map.sigma)

    def in_unit(value: float) -> str:
        return f"{number(value / field.track.factor)} {field.unit}"

    by_itself = in_unit(float(np.nanmedian(own))) if np.isfinite(own).any() else "–"
    map_sigma = "estimated" if settings.map_sigma == "auto" else in_unit(float(settings.map_sigma))
    rows = [
        ("matcher", settings.name),
        ("track's position, 1σ", f"{number(uncertainty.position)} m"),
        ("track's velocity, 1σ", f"{number(uncertainty.velocity)} m/s"),
        ("readings, 1σ (median)", in_unit(float(np.median(field.track.sigma)))),
        ("map error, 1σ, at least", map_sigma),
        ("map error, 1σ, by the map itself (median)", by_itself),
        ("map error, correlation length", f"{number(settings.map_correlation_length)} m"),
        ("unknown constant, 1σ", in_unit(settings.bias_sigma)),
    ]
    return Table("Settings", ("", ""), rows)
