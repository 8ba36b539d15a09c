"""Matches of measured lines: error, 1-sigma and NEES of fixes; normalised innovations; the place
of least squares."""

import dataclasses
import math
from collections.abc import Sequence
from contextlib import nullcontext
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from scipy.stats import chi2

from isogal.arrays import Array, Booleans
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.consistency import nees_per_axis
from isogal.maps.field_map import FieldMap
from isogal.scenario import Matcher
from isogal.tracks import bank
from isogal.tracks.map_error import MapError
from isogal.tracks.matching import Match, Uncertainty, match_track
from isogal.tracks.track import fit_to_map
from measured_data.lines import Line, Shift

AWAY = 3000.0
"""m, how far off the navigator is, and the 1-sigma per axis that it claims."""
WHOLE = 1000
"""Batch length that takes a line at once."""
WHITE = 1.0
"""m, correlation length of map errors that are as good as independent."""


Row = dict[str, str | float | None]
"""Figures of a match (`row_of`)."""
Summary = dict[str, float | Sequence[Row]]
"""Figures of many matches (`summary_of`), and `nis`, normalised innovation squared, where it is
known."""


class Noise(NamedTuple):
    """What is assumed of the errors of map and readings."""

    correlation_length: float
    """m, of the map's error."""
    sensor_sigma: float
    """1-sigma of the readings' white noise, in the map's unit."""

    @property
    def white(self) -> "Noise":
        """The same with independent map errors."""
        return self._replace(correlation_length=WHITE)


def noise_of(fit: MapError, least_sensor: float = 0.0) -> Noise:
    """Return the noise that reference tracks show."""
    return Noise(fit.correlation_length, max(fit.sensor_sigma, least_sensor))


def settings_of(fit: MapError) -> dict[str, float]:
    """Return the parameters of a map's error as plain numbers."""
    return {name: float(value) for name, value in dataclasses.asdict(fit).items()}


def residuals(line: Line, field_map: FieldMap) -> tuple[Array, Booleans]:
    """Return readings less map at the true positions, and where the map has a value and an
    error."""
    track = line.track(1.0)
    value = track.value - track.offset - field_map.value(line.latitude, line.longitude)
    known = np.isfinite(value) & np.isfinite(field_map.sigma_at(line.latitude, line.longitude))
    return value, known


def nis(line: Line, field_map: FieldMap, noise: Noise) -> tuple[float, float]:
    """Return the normalised innovation squared per reading, r' R⁻¹ r / n, and that of the line's
    mean residual alone.

    The second is one number with mean 1, too: it shows whether the assumed correlation of errors
    along a line is right."""
    value, keep = residuals(line, field_map)
    latitude, longitude, value = line.latitude[keep], line.longitude[keep], value[keep]
    sigma = field_map.sigma_at(latitude, longitude)
    apart = horizontal_difference(latitude[:, None], longitude[:, None], latitude, longitude)
    correlation = np.exp(-np.hypot(apart[..., 0], apart[..., 1]) / noise.correlation_length)
    covariance = correlation * sigma[:, None] * sigma + noise.sensor_sigma**2 * np.eye(value.size)
    mean = value.mean() ** 2 / (covariance.sum() / value.size**2)
    return float(value @ np.linalg.solve(covariance, value)) / value.size, float(mean)


def bearings(count: int) -> list[Shift]:
    """Return shifts of `AWAY` in evenly spread directions."""
    angles = 2.0 * np.pi * np.arange(count) / count
    return [(AWAY * math.cos(a), AWAY * math.sin(a)) for a in angles]


def match_line(
    line: Line,
    field_map: FieldMap,
    noise: Noise,
    shift: Shift,
    *,
    batch_length: int = WHOLE,
    chained: bool = False,
    checked: bool = True,
) -> list[Match]:
    """Match a line whose positions are off by a shift; see `isogal.tracks.matching.match_track`
    for `chained`. `checked`: whether a jackknife widens the fixes."""
    settings = Matcher(batch_length=batch_length, map_correlation_length=noise.correlation_length)
    track, _ = fit_to_map(line.track(noise.sensor_sigma, shift), field_map)
    with nullcontext() if checked else patch.object(bank, "excess", lambda *_: np.zeros((2, 2))):
        return match_track(track, field_map, settings, Uncertainty(position=AWAY), chained=chained)


def row_of(line: Line, match: Match, aided: bool = False) -> Row:
    """Return error, 1-sigma axes and NEES of a match; `aided` = of the track after it, with the
    prior and all earlier fixes."""
    last = match.rows.stop - 1
    place = match.position if aided else (match.fix.latitude, match.fix.longitude)
    covariance = match.covariance[:2, :2] if aided else match.fix.covariance
    if not (match.fix.published or aided):
        return {"line": line.name, "reason": match.fix.reason}
    error = horizontal_difference(*place, line.latitude[last], line.longitude[last])
    return figures_of(line.name, error, covariance)


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


def whole_line(
    line: Line,
    field_map: FieldMap,
    noise: Noise,
    shift: Shift,
    *,
    checked: bool = True,
    aided: bool = False,
) -> Row:
    """Match a line as one batch and return its row (see `match_line` and `row_of`)."""
    return row_of(line, match_line(line, field_map, noise, shift, checked=checked)[0], aided)


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


def rigid_search(line: Line, field_map: FieldMap, shift: Shift, reach: float = 6000.0) -> float:
    """Return the error (m) of the place with the least squares of the residuals about their mean,
    within a reach of the navigator."""
    track = line.track(1.0, shift)
    level = track.value - track.offset
    slope = track.jacobian(field_map.quantity)[:, 0]
    north, east = metres_per_radian(track.latitude)
    side = np.arange(-reach, reach + 1.0, 100.0)
    best, found = np.inf, np.zeros(2)
    for move in side:
        latitude = track.latitude - move / north
        value = field_map.value(latitude, track.longitude - side[:, None] / east) + slope * move
        known = np.isfinite(value)
        misfit = level - value
        enough = known.mean(axis=1) > 0.8
        if not enough.any():
            continue
        spread = np.full(side.size, np.inf)
        spread[enough] = np.nanvar(misfit[enough], axis=1)
        k = int(np.argmin(spread))
        if spread[k] < best:
            best, found = float(spread[k]), np.array([move, side[k]])
    return float(np.hypot(*(found - shift)))
