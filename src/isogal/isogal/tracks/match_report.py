"""The report of `isogal match`: the track on the map, its readings against the map, and a table of
the fixes."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isogal.evaluation.html_report import Illustration, Section, Table, number, write_report
from isogal.maps.tiled_map import ScalarMap
from isogal.scenario import Matcher
from isogal.tracks.figures import readings_figure, track_map_figure
from isogal.tracks.matching import Match, Uncertainty
from isogal.tracks.shift_figure import has_shifts, shift_figure
from isogal.tracks.track import Track


def write_match_report(
    track: Track,
    field_map: ScalarMap,
    settings: Matcher,
    uncertainty: Uncertainty,
    matches: Sequence[Match],
    out_dir: str | Path,
    *,
    chained: bool = False,
) -> Path:
    """Write `report.html` with two PNG figures beside it; return the path of the page."""
    published = sum(match.fix.published for match in matches)
    start = "what the earlier ones told" if chained else "the same prior"
    illustrations = [
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
    if has_shifts(matches):
        illustrations.append(
            Illustration(
                "shifts",
                shift_figure(matches),
                "Where the track may be: log posterior over its error, all noise models together;"
                " the ellipse is the fix's with the prior, 2-sigma, and + no error at all.",
            )
        )
    sections = [
        Section(
            "Result",
            [
                f"{published} fixes from {len(matches)} batches of {settings.batch_length}"
                f" readings; each batch starts from {start}."
            ],
            illustrations,
            [_fixes(matches), *_estimates(field_map, matches)],
        ),
        Section(
            "What was assumed", tables=[_assumptions(track, field_map, settings, uncertainty)]
        ),
    ]
    return write_report(
        out_dir,
        "Recorded track",
        sections,
        subtitle=f"{Path(track.where).name} against {field_map.provenance}",
    )


def _fixes(matches: Sequence[Match]) -> Table:
    rows = []
    for match in matches:
        fix = match.fix
        row = [f"{fix.time:.10g}"]
        if fix.published:
            axes = np.sqrt(np.linalg.eigvalsh(fix.covariance))
            row += [
                f"{math.degrees(fix.latitude):.5f}",
                f"{math.degrees(fix.longitude):.5f}",
                number(axes[1]),
                number(axes[0]),
                "",
            ]
        else:
            row += ["–", "–", "–", "–", str(fix.reason)]
        latitude, longitude = np.degrees(match.position)
        axes = np.sqrt(np.linalg.eigvalsh(match.covariance[:2, :2]))
        row[-1:-1] = [f"{latitude:.5f}, {longitude:.5f}", f"{number(axes[1])} × {number(axes[0])}"]
        rows.append(row)
    header = (
        "time (s)",
        "latitude (deg)",
        "longitude (deg)",
        "long half-axis, 1σ (m)",
        "short half-axis, 1σ (m)",
        "with the prior (deg)",
        "its half-axes, 1σ (m)",
        "no fix because",
    )
    return Table("Fixes, from the measurements alone, and positions with the prior", header, rows)


def _estimates(field_map: ScalarMap, matches: Sequence[Match]) -> list[Table]:
    """Return what was estimated of the noise; nothing where it was not."""
    unit, factor = field_map.file_unit or field_map.unit, field_map.file_factor
    if unit == "m/s²":
        unit, factor = "mGal", 1e-5
    rows = []
    for match in matches:
        numbers = match.fix.diagnostics
        level = [
            number(numbers[key] / factor) for key in ("offset", "offset_sigma") if key in numbers
        ]
        if match.shifts is None or "map_sigma" not in numbers:
            continue
        rows.append(
            [
                f"{match.fix.time:.10g}",
                number(numbers["map_sigma"] / factor),
                number(numbers["map_correlation_length"]),
                " ± ".join(level),
                f"{numbers['readings']:.0f}",
                f"{numbers['readings_left_out']:.0f}",
                f"{numbers['misfit']:.2f}",
                f"{numbers['probability']:.3f} of {numbers['places']:.0f}",
            ]
        )
    header = (
        "time (s)",
        f"map error, 1σ ({unit})",
        "its correlation length (m)",
        f"readings above the map ({unit})",
        "readings used",
        "left out",
        "misfit",
        "probability of the place, places",
    )
    return [Table("Estimated with the fixes", header, rows)] if rows else []


def _assumptions(
    track: Track, field_map: ScalarMap, settings: Matcher, uncertainty: Uncertainty
) -> Table:
    unit = field_map.file_unit or field_map.unit
    factor = field_map.file_factor
    if unit == "m/s²":
        unit, factor = "mGal", 1e-5

    def in_unit(value: float) -> str:
        return f"{number(value / factor)} {unit}"

    own = np.asarray(field_map.sigma)
    map_sigma = "estimated" if settings.map_sigma == "auto" else in_unit(float(settings.map_sigma))
    rows = [
        ("matcher", settings.name),
        ("track's position, 1σ", f"{number(uncertainty.position)} m"),
        ("track's velocity, 1σ", f"{number(uncertainty.velocity)} m/s"),
        ("readings, 1σ (median)", in_unit(float(np.median(track.sigma)))),
        ("map error, 1σ, at least", map_sigma),
        (
            "map error, 1σ, by the map itself (median)",
            in_unit(float(np.nanmedian(own))) if np.isfinite(own).any() else "–",
        ),
        ("map error, correlation length", f"{number(settings.map_correlation_length)} m"),
        ("unknown constant, 1σ", in_unit(settings.bias_sigma)),
    ]
    return Table("Settings", ("", ""), rows)
