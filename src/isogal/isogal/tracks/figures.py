"""Figures of a matched track: the track on the map, its readings against the map, and how likely
each shift of it is by the readings and the prior."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style
from isogal.evaluation.figures.track import Frame
from isogal.maps.corridor import along_track
from isogal.maps.tiled_map import ScalarMap
from isogal.tracks.matching import Match
from isogal.tracks.places import Shifts
from isogal.tracks.track import Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage


RECORDED = style.UNAIDED
MATCHED = style.Line(style.BLUE, "-", 1.6)
ELLIPSE = style.Line("black", "-", 1.0)
_COLUMNS = 3
_DEPTH = 20.0
"""Natural logarithms below the best that are shown."""


def matched_positions(track: Track, matches: Sequence[Match]) -> tuple[Array, Array]:
    """Return (N,) latitude and longitude (rad) of the track, each batch moved by the estimate of
    its error; NaN in batches without a fix."""
    latitude, longitude = np.full(len(track), np.nan), np.full(len(track), np.nan)
    for match in matches:
        if match.fix.published:
            latitude[match.rows], longitude[match.rows] = track.moved(match.rows, match.error)
    return latitude, longitude


def _edged(panel: "Axes", places: Array, line: style.Line, label: str = "_") -> None:
    """Draw a line, (2, N), with a white edge that keeps it visible on dark and on light ground."""
    panel.plot(*places, color="white", linewidth=line.width + 2.0)
    panel.plot(*places, **line.options(), label=label)


@style.journal
def track_map_figure(track: Track, field_map: ScalarMap, matches: Sequence[Match]) -> "Figure":
    """Draw the map, the track as recorded and as moved by the fixes, and the fixes with their
    2-sigma ellipses."""
    fixes = [match.fix for match in matches if match.fix.published]
    recorded = np.unwrap(track.longitude)
    middle = 0.5 * float(recorded.min() + recorded.max())

    def near(longitude: ArrayLike) -> Array:
        """Return longitudes less than half a circle from the middle of the track."""
        apart = np.asarray(longitude, dtype=np.float64) - middle
        return middle + np.remainder(apart + math.pi, 2.0 * math.pi) - math.pi

    latitude, longitude = matched_positions(track, matches)
    places = np.array([fix.latitude for fix in fixes]), near([fix.longitude for fix in fixes])
    frame = Frame.around(np.r_[track.latitude, places[0]], np.r_[recorded, places[1]], 2e3)
    figure = style.new_figure(frame.height + 0.6)
    panel = figure.add_subplot()
    frame.draw(panel, field_map)
    for label, line, y, x in (
        ("track as recorded", RECORDED, track.latitude, recorded),
        ("track moved by the fixes" if fixes else "_", MATCHED, latitude, near(longitude)),
    ):
        _edged(panel, np.degrees((x, y)), line, label)
    for fix, *place in zip(fixes, *places, strict=True):
        edge = place + style.ellipse(fix.covariance, 2.0) / metres_per_radian(fix.latitude)
        label = "_" if fix is not fixes[0] else r"fix with its $2\sigma$ ellipse"
        _edged(panel, np.degrees(edge.T[::-1]), ELLIPSE, label)
    panel.plot(*np.degrees(places[::-1]), "o", **style.FIX_DOT)
    style.legend_below(figure)
    return figure


@style.journal
def readings_figure(track: Track, field_map: ScalarMap, matches: Sequence[Match]) -> "Figure":
    """Draw the readings (less offset) and the map's values along the track as recorded and as
    matched; below, the differences."""
    figure = style.new_figure(4.4)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    distance = along_track(track.latitude, track.longitude) / 1e3
    scale = style.field_scale(field_map)
    level = track.value - track.offset
    dots = {"color": "0.25", "markersize": 2.4, "markeredgewidth": 0.0}
    upper.plot(distance, scale(level), "o", **dots, label="readings")
    recorded = track.latitude, track.longitude
    for places, line, label in (
        (recorded, RECORDED, "as recorded"),
        (matched_positions(track, matches), MATCHED, "moved by the fixes"),
    ):
        values = field_map.value(*places)
        upper.plot(distance, scale(values), **line.options(), label=f"map along the track {label}")
        lower.plot(distance, (level - values) / scale.unit, **line.options())
    for match in matches:
        for panel in (upper, lower):
            panel.axvline(distance[match.rows.stop - 1], color="0.7", linewidth=0.6, zorder=0)
    lower.axhline(0.0, color="0.5", linewidth=0.6, zorder=0)
    upper.set_ylabel(scale.two_lines)
    lower.set_ylabel(f"reading less map\n{scale.unit_label}")
    lower.set_xlabel("distance along the track (km); grey: ends of batches")
    lower.set_xlim(float(distance[0]), float(distance[-1]))
    style.legend_below(figure, columns=2)
    return figure


@style.journal
def shift_figure(matches: Sequence[Match]) -> "Figure":
    """Draw the log posterior over all shifts of the batches that have kept it, and the 2-sigma
    ellipse of the posterior with its widened covariance."""
    shown = [(match, s) for match in matches if (s := match.shifts) is not None]
    columns = min(_COLUMNS, len(shown))
    rows = math.ceil(len(shown) / columns)
    width = style.WIDTH if columns > 1 else 4.6
    figure = style.new_figure(0.6 + rows * width / columns * 0.88, width)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    images = [_shifts(panel, *one) for panel, one in zip(panels, shown, strict=False)]
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    figure.colorbar(
        images[0], ax=list(panels), label="log posterior below its maximum", pad=0.02, shrink=0.7
    )
    return figure


def _shifts(panel: "Axes", match: Match, shifts: Shifts) -> "AxesImage":
    """Draw the first grid, whose cells are all that the prior allows."""
    wide = shifts.overview or shifts
    cells, log = wide.centres, wide.log_density
    index = np.rint((cells - cells.min(axis=0)) / wide.size).astype(int)
    picture = np.full(index.max(axis=0) + 1, np.nan)
    picture[tuple(index.T)] = np.maximum(log - log.max(), -_DEPTH)
    (south, west), (north, east) = np.array([cells.min(axis=0), cells.max(axis=0)]) / 1e3
    half = 0.5e-3 * wide.size
    image = panel.imshow(
        picture,
        origin="lower",
        extent=(west - half, east + half, south - half, north + half),
        aspect="equal",
        vmin=-_DEPTH,
        vmax=0.0,
        cmap="viridis",
    )
    mean, covariance = shifts.moments
    if match.fix.published:
        covariance = match.covariance[:2, :2]
    _edged(panel, (mean + style.ellipse(covariance, 2.0)).T[::-1] / 1e3, ELLIPSE)
    panel.plot(0.0, 0.0, "+", color="white", markersize=6.0)
    state = "fix" if match.fix.published else "no fix"
    panel.set_title(f"to {match.fix.time:.10g} s: {state}", fontsize="small")
    panel.set_xlabel("error of the track east (km)")
    panel.set_ylabel("north (km)")
    panel.grid(False)
    return image
