"""Figures of a matched track: the track on the map, and its readings against the map."""

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
from isogal.tracks.track import Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


RECORDED = style.UNAIDED
MATCHED = style.Line(style.BLUE, "-", 1.6)
_TALLEST, _FLATTEST = 1.5, 0.35
"""Limits of the map panel's height over its width."""
_INSET, _EDGE = 0.25, 0.03
"""Size of the inset, and its distance from the edge, in shares of the panel."""
_DOT = 0.015
"""1-sigma over half the map panel's width below which an ellipse is drawn once more."""
_LATTICE = 420
"""Pixels along each side of the map panel."""


def matched_positions(track: Track, matches: Sequence[Match]) -> tuple[Array, Array]:
    """Return (N,) latitude and longitude (rad) of the track, each batch moved by the estimate of
    its error; NaN in batches without a fix."""
    latitude, longitude = np.full(len(track), np.nan), np.full(len(track), np.nan)
    for match in matches:
        if match.fix.published:
            north, east = metres_per_radian(track.latitude[match.rows])
            since = track.time[match.rows] - track.time[match.rows.stop - 1]
            latitude[match.rows] = (
                track.latitude[match.rows] - (match.error[0] + match.error[2] * since) / north
            )
            longitude[match.rows] = (
                track.longitude[match.rows] - (match.error[1] + match.error[3] * since) / east
            )
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
    for number, match in enumerate(m for m in matches if m.fix.published):
        label = "track moved by the fixes" if number == 0 else "_"
        draw(latitude[match.rows], _near(longitude[match.rows], middle[1]), MATCHED, label)
    for number, match in enumerate(m for m in matches if m.fix.published):
        _ellipse(panel, match, middle[1], number == 0)
    _magnify(panel, track, [m for m in matches if m.fix.published], middle[1], float(half.max()))
    panel.set_xlabel("longitude (deg)")
    panel.set_ylabel("latitude (deg)")
    style.legend_below(figure)
    return figure


def _magnify(
    panel: "Axes", track: Track, published: Sequence[Match], middle: float, half: float
) -> None:
    """Draw the last fix once more where its ellipse is too small to be seen."""
    if not published:
        return
    fix = published[-1].fix
    sigma = math.sqrt(float(np.diag(fix.covariance).max()))
    if sigma > _DOT * half:
        return
    north, east = (float(m) for m in metres_per_radian(fix.latitude))
    x = math.degrees(float(_near(np.array(fix.longitude), middle)))
    y = math.degrees(fix.latitude)
    inset = panel.inset_axes((*_free_corner(panel, track, middle, (x, y)), _INSET, _INSET))
    _ellipse(inset, published[-1], middle, False)
    reach = 3.0 * sigma
    inset.set_xlim(x - math.degrees(reach / east), x + math.degrees(reach / east))
    inset.set_ylim(y - math.degrees(reach / north), y + math.degrees(reach / north))
    style.bare(inset, f"last fix, {2.0 * reach:.0f} m wide", fontsize=5)


def _free_corner(
    panel: "Axes", track: Track, middle: float, fix: tuple[float, float]
) -> tuple[float, float]:
    """Return the lower left corner, in shares of the panel, of an inset that hides least of the
    track, and of such insets the one that is farthest from a fix (deg)."""
    x = np.append(np.degrees(_near(track.longitude, middle)), fix[0])
    y = np.append(np.degrees(track.latitude), fix[1])
    (west, east), (south, north) = panel.get_xlim(), panel.get_ylim()
    x, y = (x - west) / (east - west), (y - south) / (north - south)
    far = 1.0 - _INSET - _EDGE

    def hidden(corner: tuple[float, float]) -> tuple[int, float]:
        apart = np.stack([x - corner[0], y - corner[1]]) - 0.5 * _INSET
        count = int((np.abs(apart) < 0.5 * _INSET + _EDGE).all(axis=0).sum())
        return count, -float(np.hypot(*apart[:, -1]))

    return min(((a, b) for a in (_EDGE, far) for b in (_EDGE, far)), key=hidden)


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


def _ellipse(panel: "Axes", match: Match, middle: float, first: bool) -> None:
    """Draw a fix and its 2-sigma ellipse."""
    edge = style.ellipse(match.fix.covariance, 2.0)
    north, east = metres_per_radian(match.fix.latitude)
    longitude = float(_near(np.array(match.fix.longitude), middle))
    x, y = (
        np.degrees(longitude + edge[:, 1] / east),
        np.degrees(match.fix.latitude + edge[:, 0] / north),
    )
    label = r"fix with its $2\sigma$ ellipse" if first else "_"
    panel.plot(x, y, color="white", linewidth=2.6)
    panel.plot(x, y, color="black", linewidth=1.0, label=label)
    dot: dict[str, Any] = {"color": style.SKY, "markeredgecolor": "black", "markeredgewidth": 0.6}
    panel.plot(
        math.degrees(longitude), math.degrees(match.fix.latitude), "o", **dot, markersize=4.0
    )


@style.journal
def readings_figure(track: Track, field_map: ScalarMap, matches: Sequence[Match]) -> "Figure":
    """Draw the readings (less offset) and the map's values along the track as recorded and as
    matched; below, the differences."""
    figure = style.new_figure(4.4)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    distance = along_track(track.latitude, track.longitude) / 1e3
    scale = style.field_scale(field_map)
    level = track.value - track.offset
    moved = matched_positions(track, matches)
    curves = [
        (
            field_map.value(track.latitude, track.longitude),
            RECORDED,
            "map along the track as recorded",
        ),
        (field_map.value(*moved), MATCHED, "map along the track moved by the fixes"),
    ]
    marks = {
        "linestyle": "none",
        "marker": "o",
        "markersize": 2.4,
        "markerfacecolor": "0.25",
        "markeredgewidth": 0.0,
    }
    upper.plot(distance, scale(level), **marks, label="readings")
    for values, line, label in curves:
        upper.plot(distance, scale(values), **line.options(), label=label)
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
