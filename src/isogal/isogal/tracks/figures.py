"""Figures of a matched track: the track on the map, its readings against the map, and how likely
each shift of it is by the readings and the prior."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.figures import style
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
_TALLEST, _FLATTEST = 1.5, 0.35
"""Limits of the map panel's height over its width."""
_LATTICE = 420
"""Pixels along each side of the map panel."""
_MOST_PANELS, _COLUMNS = 6, 3
_DEPTH = 20.0
"""Natural logarithms below the best that are shown."""
_INSET = 0.38
"""Side of what is enlarged, in that of the panel."""


def matched_positions(track: Track, matches: Sequence[Match]) -> tuple[Array, Array]:
    """Return (N,) latitude and longitude (rad) of the track, each batch moved by the estimate of
    its error; NaN in batches without a fix."""
    latitude, longitude = np.full(len(track), np.nan), np.full(len(track), np.nan)
    for match in matches:
        if match.fix.published:
            rows = match.rows
            since = track.time[rows] - track.time[rows.stop - 1]
            moved = match.error[:2] + np.outer(since, match.error[2:])
            north, east = metres_per_radian(track.latitude[rows])
            latitude[rows] = track.latitude[rows] - moved[:, 0] / north
            longitude[rows] = track.longitude[rows] - moved[:, 1] / east
    return latitude, longitude


@style.journal
def track_map_figure(track: Track, field_map: ScalarMap, matches: Sequence[Match]) -> "Figure":
    """Draw the map, the track as recorded and as moved by the fixes, and the fixes with their
    2-sigma ellipses."""
    half = _half_widths(track, matches)
    shape = float(half[0] / half[1])
    width = style.WIDTH if shape < 1.0 else 4.9
    figure = style.new_figure(width * shape * 0.84 + 0.9, width)
    panel = figure.add_subplot()
    middle = _middle(track)
    metres = np.array(metres_per_radian(middle[0]))
    _background(panel, field_map, middle, half / metres)

    def draw(latitude: Array, longitude: Array, line: style.Line, label: str) -> None:
        x, y = np.degrees(np.unwrap(longitude)), np.degrees(latitude)
        # the white edge keeps the line visible on dark and on light ground
        panel.plot(x, y, color="white", linewidth=line.width + 2.0)
        panel.plot(x, y, **line.options(), label=label)

    draw(track.latitude, track.longitude, RECORDED, "track as recorded")
    latitude, longitude = matched_positions(track, matches)
    published = [match for match in matches if match.fix.published]
    for number, match in enumerate(published):
        label = "track moved by the fixes" if number == 0 else "_"
        draw(latitude[match.rows], _near(longitude[match.rows], middle[1]), MATCHED, label)
    for number, match in enumerate(published):
        _fix(panel, match, middle[1], number == 0)
    panel.set_xlabel("longitude (deg)")
    panel.set_ylabel("latitude (deg)")
    style.legend_below(figure)
    return figure


def _middle(track: Track) -> tuple[float, float]:
    longitude = np.unwrap(track.longitude)
    return 0.5 * float(track.latitude.min() + track.latitude.max()), 0.5 * float(
        longitude.min() + longitude.max()
    )


def _near(longitude: Array, middle: float) -> Array:
    """Return longitudes (rad) less than half a circle from the middle."""
    return middle + np.remainder(longitude - middle + math.pi, 2.0 * math.pi) - math.pi


def _half_widths(track: Track, matches: Sequence[Match]) -> Array:
    """Return north and east half-width of the map panel, m: track and fixes with a margin."""
    middle = _middle(track)
    north, east = (float(m) for m in metres_per_radian(middle[0]))
    half = 0.5 * np.array(
        [np.ptp(track.latitude) * north, np.ptp(np.unwrap(track.longitude)) * east]
    )
    widest = half + max(0.15 * float(np.hypot(*half)), 3e3)
    for match in matches:
        if match.fix.published:
            away = horizontal_difference(match.fix.latitude, match.fix.longitude, *middle)
            reach = np.abs(away) + 2.0 * np.sqrt(np.diag(match.fix.covariance))
            # a fix may leave one direction almost open, so its ellipse does not widen it at will
            half = np.maximum(half, np.minimum(reach, widest))
    half += max(0.1 * float(np.hypot(*half)), 2e3)
    half[0] = max(half[0], _FLATTEST * half[1])
    half[1] = max(half[1], half[0] / _TALLEST)
    return half


def _background(
    panel: "Axes", field_map: ScalarMap, middle: tuple[float, float], half: Array
) -> None:
    scale = style.field_scale(field_map)
    rows, columns = (np.linspace(-h, h, _LATTICE) for h in half)
    values = scale(field_map.value(middle[0] + rows[:, None], middle[1] + columns[None, :]))
    figure: Any = panel.figure
    west, east = (math.degrees(middle[1] + s * half[1]) for s in (-1.0, 1.0))
    south, north = (math.degrees(middle[0] + s * half[0]) for s in (-1.0, 1.0))
    panel.set_facecolor("0.9")  # where there is no map
    panel.grid(False)
    if np.isfinite(values).any():
        low, high = np.nanpercentile(values, [1.0, 99.0])
        image = panel.imshow(
            values,
            extent=(west, east, south, north),
            origin="lower",
            cmap=style.FIELD_COLOURS,
            vmin=low,
            vmax=high,
            aspect=1.0 / math.cos(middle[0]),
        )
        figure.colorbar(image, ax=panel, label=scale.label, shrink=0.9, pad=0.02, extend="both")
    panel.set_xlim(west, east)
    panel.set_ylim(south, north)


def _fix(panel: "Axes", match: Match, middle: float, first: bool) -> None:
    """Draw a fix and its 2-sigma ellipse."""
    fix = match.fix
    place = np.array([fix.latitude, _near(np.array(fix.longitude), middle)])
    edge = style.ellipse(fix.covariance, 2.0) / metres_per_radian(fix.latitude)
    y, x = np.degrees(place + edge).T
    label = r"fix with its $2\sigma$ ellipse" if first else "_"
    panel.plot(x, y, color="white", linewidth=2.6)
    panel.plot(x, y, color="black", linewidth=1.0, label=label)
    y, x = np.degrees(place)
    dot: dict[str, Any] = {"color": style.SKY, "markeredgecolor": "black", "markeredgewidth": 0.6}
    panel.plot(x, y, "o", **dot, markersize=4.0)


@style.journal
def readings_figure(track: Track, field_map: ScalarMap, matches: Sequence[Match]) -> "Figure":
    """Draw the readings (less offset) and the map's values along the track as recorded and as
    matched; below, the differences."""
    figure = style.new_figure(4.4)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    distance = along_track(track.latitude, track.longitude) / 1e3
    scale = style.field_scale(field_map)
    level = track.value - track.offset
    upper.plot(
        *(distance, scale(level), "o"),
        color="0.25",
        markersize=2.4,
        markeredgewidth=0.0,
        label="readings",
    )
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
    """Draw the log posterior over all shifts of up to six batches that have one, and the 2-sigma
    ellipse of the posterior with its widened covariance."""
    shown = [(match, s) for match in matches if (s := match.shifts) is not None][:_MOST_PANELS]
    columns = min(_COLUMNS, len(shown))
    rows = math.ceil(len(shown) / columns)
    width = style.WIDTH if columns > 1 else 4.6
    figure = style.new_figure(0.6 + rows * width / columns * 0.88, width)
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    images = [_shifts(panel, *one) for panel, one in zip(panels, shown, strict=False)]
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    figure.colorbar(
        images[0], ax=list(panels), label="log posterior below its maximum", pad=0.02, shrink=0.7
    )
    return figure


def _shifts(panel: "Axes", match: Match, shifts: Shifts) -> "AxesImage":
    wide = shifts.overview or shifts
    log = wide.log_density
    image = _cells(panel, wide.centres, log - log.max(), wide.size)
    west, east = image.get_extent()[:2]
    mean, covariance = shifts.moments
    if match.fix.published:
        covariance = match.covariance[:2, :2]
    panel.plot(*_ellipse(mean, covariance), color="white", linewidth=2.4)
    panel.plot(*_ellipse(mean, covariance), color="black", linewidth=1.0)
    panel.plot(0.0, 0.0, "+", color="white", markersize=6.0)
    state = "fix" if match.fix.published else "no fix"
    panel.set_title(f"to {match.fix.time:.10g} s: {state}", fontsize="small")
    panel.set_xlabel("error of the track east (km)")
    panel.set_ylabel("north (km)")
    panel.grid(False)
    if 4.0 * math.sqrt(float(covariance.max())) < 0.08e3 * (east - west):
        _inset(panel, shifts, mean, covariance)
    return image


def _cells(panel: "Axes", cells: Array, depth: Array, size: float) -> "AxesImage":
    """Draw (K,) values of (K, 2) cells of a regular grid, m north and east, of a size (m)."""
    index = np.rint((cells - cells.min(axis=0)) / size).astype(int)
    picture = np.full(index.max(axis=0) + 1, np.nan)
    picture[tuple(index.T)] = np.maximum(depth, -_DEPTH)
    (south, west), (north, east) = cells.min(axis=0) - 0.5 * size, cells.max(axis=0) + 0.5 * size
    return panel.imshow(
        picture,
        origin="lower",
        extent=(west / 1e3, east / 1e3, south / 1e3, north / 1e3),
        cmap="viridis",
        vmin=-_DEPTH,
        vmax=0.0,
        aspect="equal",
    )


def _inset(panel: "Axes", shifts: Shifts, mean: Array, covariance: Array) -> None:
    """Draw what is too small to be seen."""
    half = 3.5 * math.sqrt(float(np.diag(covariance).max())) / 1e3
    corner = (0.04, 0.58) if mean[1] > 0.0 else (0.58, 0.58)
    inset = panel.inset_axes((*corner, _INSET, _INSET))
    log = shifts.log_density
    near = np.abs(shifts.centres - mean).max(axis=1) < 1.2e3 * half
    _cells(inset, shifts.centres[near], (log - log.max())[near], shifts.size)
    inset.plot(*_ellipse(mean, covariance), color="black", linewidth=1.0)
    inset.set_xlim(mean[1] / 1e3 - half, mean[1] / 1e3 + half)
    inset.set_ylim(mean[0] / 1e3 - half, mean[0] / 1e3 + half)
    style.bare(inset, f"{2e3 * half:.0f} m wide", fontsize=6, bbox=style.LABEL_BOX)
    panel.indicate_inset_zoom(inset, edgecolor="white")


def _ellipse(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Return east and north (km) of the 2-sigma ellipse."""
    edge = mean + style.ellipse(covariance, 2.0)
    return edge[:, 1] / 1e3, edge[:, 0] / 1e3
