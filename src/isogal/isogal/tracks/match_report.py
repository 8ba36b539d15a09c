"""The report of `isogal match`: the track on the map, its readings against the map, and a table of
the fixes."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.html_report import Illustration, Section, Table, number, write_report
from isogal.tracks.fields import TrackField
from isogal.tracks.figures import readings_figure, shift_figure, track_map_figure
from isogal.tracks.matching import Match, Uncertainty
from isogal.tracks.results import flat, found


def write_match_report(
    field: TrackField,
    uncertainty: Uncertainty,
    matches: Sequence[Match],
    out_dir: str | Path,
    *,
    chained: bool = False,
) -> Path:
    """Write `report.html` with PNG figures beside it; return the path of the page.

    Parameters
    ----------
    field : TrackField
        The first of those that were matched, of one channel.
    uncertainty : Uncertainty
        What was assumed of the track.
    matches : sequence of Match
    out_dir : path
    chained : bool
        Whether each batch started from what the earlier ones had found.
    """
    track, field_map = field.track, field.scalar_map
    published = sum(match.fix.published for match in matches)
    start = "what the earlier ones told" if chained else "the same prior"
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
    result = Section(
        "Result",
        [
            f"{published} fixes from {len(matches)} batches of {field.settings.batch_length}"
            f" readings; each batch starts from {start}."
        ],
        figures,
        [_fixes(matches), *_estimates(field, matches)],
    )
    return write_report(
        out_dir,
        "Recorded track",
        [result, Section("What was assumed", tables=[_assumptions(field, uncertainty)])],
        subtitle=f"{Path(track.where).name} against {field_map.provenance}",
    )


def _fixes(matches: Sequence[Match]) -> Table:
    rows = []
    for match in matches:
        fix = match.fix
        place, axes = ["–", "–"], ("–", "–")
        if fix.published:
            place = [f"{math.degrees(one):.5f}" for one in (fix.latitude, fix.longitude)]
            axes = _half_axes(fix.covariance)
        latitude, longitude = np.degrees(match.position)
        rows.append(
            {
                "time (s)": f"{fix.time:.10g}",
                "latitude (deg)": place[0],
                "longitude (deg)": place[1],
                "long half-axis, 1σ (m)": axes[0],
                "short half-axis, 1σ (m)": axes[1],
                "with the prior (deg)": f"{latitude:.5f}, {longitude:.5f}",
                "its half-axes, 1σ (m)": " × ".join(_half_axes(match.covariance[:2, :2])),
                "no fix because": "" if fix.published else str(fix.reason),
            }
        )
    return _table("Fixes, from the measurements alone, and positions with the prior", rows)


def _half_axes(covariance: Array) -> tuple[str, str]:
    """Return the longer and the shorter one of a covariance (2, 2)."""
    short, long = np.sqrt(np.linalg.eigvalsh(covariance))
    return number(long), number(short)


def _table(title: str, rows: Sequence[Mapping[str, str]]) -> Table:
    return Table(title, tuple(rows[0]), [tuple(row.values()) for row in rows])


def _estimates(field: TrackField, matches: Sequence[Match]) -> list[Table]:
    """Return what was estimated of the noise, by its names in files of results; nothing where it
    was not."""
    rows = [
        {"time (s)": f"{match.fix.time:.10g}"}
        | {key: number(value) for key, value in flat(estimates).items()}
        for match in matches
        if (estimates := found(match, [field]))
    ]
    title = f"Estimated with the fixes (sigma and offset in {field.unit}, length in m)"
    return [_table(title, rows)] if rows else []


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
