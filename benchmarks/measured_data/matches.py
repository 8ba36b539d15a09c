"""Figures of matches of measured lines: error, 1-sigma and NEES of fixes."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.consistency import nees_per_axis
from isogal.tracks.matching import Match
from measured_data.lines import Line, Shift

AWAY = 3000.0
"""m, how far off the navigator is, and the 1-sigma per axis that it claims."""
WHOLE = 1000
"""Batch length that takes a line at once."""
Row = dict[str, str | float | None]
"""Figures of a match (`row_of`)."""
Summary = dict[str, float | Sequence[Row]]
"""Figures of many matches (`summary_of`), and `nis`, normalised innovation squared, where it is
known."""


def bearings(count: int) -> list[Shift]:
    """Return shifts of `AWAY` in evenly spread directions."""
    angles = 2.0 * np.pi * np.arange(count) / count
    return [(AWAY * math.cos(a), AWAY * math.sin(a)) for a in angles]


def row_of(line: Line, match: Match) -> Row:
    """Return error, 1-sigma axes and NEES of a fix, or why there is none."""
    fix, last = match.fix, match.rows.stop - 1
    if not fix.published:
        return {"line": line.name, "reason": fix.reason}
    place = line.latitude[last], line.longitude[last]
    error = horizontal_difference(fix.latitude, fix.longitude, *place)
    return figures_of(line.name, error, fix.covariance)


def figures_of(name: str, error: Array, covariance: Array) -> Row:
    """Return the row of a fix with an error (2,) m and a covariance (2, 2) m²."""
    axes = np.sqrt(np.linalg.eigvalsh(covariance))
    return {
        "line": name,
        "error_m": float(np.hypot(*error)),
        "sigma_long_m": float(axes[1]),
        "sigma_short_m": float(axes[0]),
        "nees_per_axis": float(nees_per_axis(error, covariance)),
        "in_sigma": float(np.hypot(*error) / math.sqrt(axes @ axes)),
    }


def summary_of(rows: Sequence[Row]) -> Summary:
    """Return figures of many matches, and the rows themselves."""
    fixes = [row for row in rows if "error_m" in row]
    result: Summary = {"fixes": len(fixes), "batches": len(rows), "rows": rows}
    if fixes:
        errors = [row["error_m"] for row in fixes]
        result |= {
            "error_median_m": float(np.median(errors)),
            "error_90_m": float(np.percentile(errors, 90.0)),
            "error_largest_m": float(np.max(errors)),
        }
    if fixes and "nees_per_axis" in fixes[0]:
        nees = [row["nees_per_axis"] for row in fixes]
        # fixes of one line from several places are one experiment
        dof = 2 * len({row["line"] for row in fixes})
        interval = (chi2.ppf([0.025, 0.975], dof) / dof).tolist()
        result |= {
            "sigma_long_median_m": float(np.median([row["sigma_long_m"] for row in fixes])),
            "nees_per_axis": float(np.mean(nees)),
            "nees_per_axis_median": float(np.median(nees)),
            "nees_low": interval[0],
            "nees_high": interval[1],
        }
    return result
