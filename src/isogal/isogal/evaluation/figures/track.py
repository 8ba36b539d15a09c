"""The track on the map: the whole route, and close-ups of single batches with candidates and
fix."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style
from isogal.evaluation.records import Runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from isogal.maps.field_map import FieldMap


CLOSE_UPS = 3
_MAP_WIDTH, _LEGEND = 5.2, 0.6
"""in, of the overview without axes and colour bar, and of the legend."""
_FLATTEST, _TALLEST = 0.3, 0.85
"""Height over width of the overview."""
_DOTS = 700
"""Rows and columns of the overview's picture of the map at most: about as many as it has dots."""
_LATTICE = 90
"""Points along each side of a close-up's picture of the map."""


@style.journal
def track_figure(runs: Runs, field_map: "FieldMap", run: int = 0) -> "Figure":
    """One run on the map: above the whole route, below close-ups of batches early, half-way and at
    the end.

    Candidates are drawn for run 0 where the record has them.
    """
    chosen = _close_up_batches(runs)
    frame = _frame(runs)
    height = _MAP_WIDTH * frame.shape + 0.5
    if not chosen:
        figure = style.new_figure(height + _LEGEND)
        _overview(figure.add_subplot(), runs, field_map, frame, run, chosen)
    else:
        figure = style.new_figure(height + 2.4 + _LEGEND)
        halves = figure.subfigures(2, 1, squeeze=False, height_ratios=(height, 2.4 + _LEGEND))[
            :, 0
        ]
        _overview(halves[0].add_subplot(), runs, field_map, frame, run, chosen)
        for panel, batch in zip(
            halves[1].subplots(1, len(chosen), squeeze=False)[0], chosen, strict=True
        ):
            _close_up(panel, runs, field_map, run, batch, batch == chosen[0])
    style.legend_below(halves[1] if chosen else figure, columns=4, panels=figure.axes)
    return figure


def _close_up_batches(runs: Runs) -> list[int]:
    count = runs.fix_time.size
    return (
        sorted({round(f * (count - 1)) for f in np.linspace(0.0, 1.0, CLOSE_UPS)}) if count else []
    )


@dataclass(frozen=True, slots=True)
class _Frame:
    """What the overview shows: edges in rad, longitudes unwrapped like the route's."""

    south: float
    north: float
    west: float
    east: float
    stretch: float
    """Metres in a radian of latitude over those in one of longitude."""

    @property
    def shape(self) -> float:
        """Height over width."""
        return (self.north - self.south) * self.stretch / (self.east - self.west)


def _frame(runs: Runs) -> _Frame:
    """Frame the route with a margin of a tenth of its length, at least 5 km, in a shape that fills
    the page's width."""
    north, east = (float(m) for m in metres_per_radian(float(runs.latitude.mean())))
    longitude = np.unwrap(runs.longitude)
    half = 0.5 * np.array([np.ptp(runs.latitude) * north, np.ptp(longitude) * east])
    half += max(0.2 * float(np.hypot(*half)), 5e3)
    half[0] = max(half[0], _FLATTEST * half[1])
    half[1] = max(half[1], half[0] / _TALLEST)
    middle = [0.5 * float(x.min() + x.max()) for x in (runs.latitude, longitude)]
    (d_lat, d_lon) = half / (north, east)
    return _Frame(
        middle[0] - d_lat, middle[0] + d_lat, middle[1] - d_lon, middle[1] + d_lon, north / east
    )


def _drawn(field_map: "FieldMap", frame: _Frame) -> "FieldMap":
    """Cut out the part of a map in the frame, no finer than the picture's dots."""
    edges = frame.south, frame.north, frame.west, frame.east
    if field_map.strip is None:
        part = field_map.window(*edges)
        return part.thinned(*(-(-size // _DOTS) for size in part.values.shape))
    # the window of a strip would be filled with its empty part, so that is thinned first
    lat_step, lon_step = field_map.grid.latitude_step, field_map.grid.longitude_step
    rows, columns = (frame.north - frame.south) / lat_step, (frame.east - frame.west) / lon_step
    return field_map.thinned(math.ceil(rows / _DOTS), math.ceil(columns / _DOTS)).window(*edges)


def _overview(
    panel: "Axes", runs: Runs, field_map: "FieldMap", frame: _Frame, run: int, chosen: list[int]
) -> None:
    latitude, longitude = np.degrees(runs.latitude), np.degrees(np.unwrap(runs.longitude))
    part = _drawn(field_map, frame)
    scale = style.field_scale(part)
    values = scale(part.values)
    # the map may count its longitudes from another turn than the route
    turn = (
        2.0
        * math.pi
        * round((0.5 * (frame.west + frame.east) - float(part.longitude.mean())) / (2.0 * math.pi))
    )
    south, north = _edges(np.degrees(part.latitude))
    west, east = _edges(np.degrees(part.longitude + turn))
    low, high = np.nanpercentile(values, [1.0, 99.0])
    figure: Any = panel.figure
    image = panel.imshow(
        values,
        extent=(west, east, south, north),
        origin="lower",
        cmap=style.FIELD_COLOURS,
        vmin=low,
        vmax=high,
        interpolation="bilinear",
        aspect=frame.stretch,
    )
    figure.colorbar(image, ax=panel, label=scale.label, shrink=0.9, pad=0.02, extend="both")
    panel.grid(False)
    panel.set_facecolor("0.9")  # where there is no map
    panel.set_xlim(math.degrees(frame.west), math.degrees(frame.east))
    panel.set_ylim(math.degrees(frame.south), math.degrees(frame.north))
    # a white edge keeps lines visible on dark and on light ground
    panel.plot(longitude, latitude, color="white", linewidth=3.2)
    panel.plot(longitude, latitude, **style.TRUTH.options(), label="true track")
    metres_north, metres_east = metres_per_radian(runs.latitude)
    panel.plot(
        longitude + np.degrees(runs.unaided_error[run, :, 1] / metres_east),
        latitude + np.degrees(runs.unaided_error[run, :, 0] / metres_north),
        **style.UNAIDED.options(),
        label="unaided INS",
    )
    truth_at_fix = (
        np.interp(runs.fix_time, runs.time, latitude),
        np.interp(runs.fix_time, runs.time, longitude),
    )
    metres = metres_per_radian(np.radians(truth_at_fix[0]))
    fix_latitude, fix_longitude = (
        truth_at_fix[axis] + np.degrees(runs.fix_error[run, :, axis] / metres[axis])
        for axis in range(2)
    )
    panel.plot(
        *(fix_longitude, fix_latitude, "o"),
        color=style.SKY,
        markeredgecolor="black",
        markeredgewidth=0.5,
        markersize=3.5,
        label="fix",
    )
    for number, batch in enumerate(chosen):
        panel.annotate(
            "abc"[number],
            (truth_at_fix[1][batch], truth_at_fix[0][batch]),
            xytext=(5, -11),
            textcoords="offset points",
            fontweight="bold",
            bbox={
                "boxstyle": "round,pad=0.15",
                "facecolor": "white",
                "edgecolor": "none",
                "alpha": 0.85,
            },
        )
    panel.set_xlabel("longitude (deg)")
    panel.set_ylabel("latitude (deg)")


def _edges(nodes: Array) -> tuple[float, float]:
    """Outer edges of the cells round regular nodes."""
    half = 0.5 * float(nodes[1] - nodes[0])
    return float(nodes[0]) - half, float(nodes[-1]) + half


def _close_up(
    panel: "Axes", runs: Runs, field_map: "FieldMap", run: int, batch: int, name_axes: bool
) -> None:
    """One batch end in kilometres from the truth there."""
    time = float(runs.fix_time[batch])
    latitude = float(np.interp(time, runs.time, runs.latitude))
    longitude = float(np.interp(time, runs.time, np.unwrap(runs.longitude)))
    metres = np.array([float(m) for m in metres_per_radian(latitude)])
    candidates, weights = _candidates(runs, run, batch, np.array([latitude, longitude]), metres)
    half = _half_width(runs, run, batch, candidates)
    lattice = np.linspace(-half, half, _LATTICE)
    north, east = np.meshgrid(lattice, lattice, indexing="ij")
    values = style.field_scale(field_map)(
        field_map.value(latitude + north / metres[0], longitude + east / metres[1])
    )
    km = half / 1e3
    edges = _edges(lattice / 1e3)
    panel.imshow(
        values,
        extent=(*edges, *edges),
        origin="lower",
        cmap=style.FIELD_COLOURS,
        interpolation="bilinear",
        alpha=0.55,
    )
    if np.isfinite(values).sum() > 4:
        panel.contour(
            lattice / 1e3, lattice / 1e3, values, levels=10, colors="0.45", linewidths=0.4
        )
    if candidates.size:
        panel.scatter(
            candidates[:, 1] / 1e3,
            candidates[:, 0] / 1e3,
            s=4.0 + 26.0 * weights / max(float(weights.max()), 1e-300),
            marker="+",
            color=style.BLUE,
            linewidths=0.8,
            label="candidates",
        )
    _line(
        panel,
        _relative_track(runs, time, np.zeros_like(runs.error[run]), latitude, longitude, metres),
        style.TRUTH,
    )
    unaided = _relative_track(runs, time, runs.unaided_error[run], latitude, longitude, metres)
    _line(panel, unaided, style.UNAIDED)
    aided = _relative_track(runs, time, runs.error[run], latitude, longitude, metres)
    _line(panel, aided, style.Line(style.AIDED.colour, "-", 0.8))
    navigator = runs.posterior_error[run, batch]
    _ellipse(
        panel,
        navigator,
        runs.posterior_covariance[run, batch],
        style.AIDED,
        r"navigator, $3\sigma$",
    )
    if runs.fix_reason[run][batch] is None:
        error = runs.fix_error[run, batch]
        _ellipse(
            panel,
            error,
            runs.fix_covariance[run, batch],
            style.Line("black", (0, (3, 1.5)), 1.0),
            r"fix, $3\sigma$",
        )
        panel.plot(
            *(error[1] / 1e3, error[0] / 1e3, "o"),
            color=style.SKY,
            markeredgecolor="black",
            markeredgewidth=0.5,
            markersize=3.5,
        )
    panel.plot(0.0, 0.0, "x", color="black", markersize=5, label="truth (batch end)")
    panel.set_xlim(-km, km)
    panel.set_ylim(-km, km)
    panel.set_aspect("equal")
    panel.grid(False)
    letter = "abc"[_close_up_batches(runs).index(batch)]
    status = "" if runs.fix_reason[run][batch] is None else ", no fix"
    panel.set_title(f"{letter}  {(time - runs.time[0]) / 60:.0f} min{status}", loc="left")
    panel.set_xlabel("east (km)")
    if name_axes:
        panel.set_ylabel("north (km)")


def _candidates(
    runs: Runs, run: int, batch: int, centre: Array, metres: Array
) -> tuple[Array, Array]:
    """Return (N, 2) north and east of the centre (m) and (N,) weights of a batch's candidates.

    Those of the last scan alone where the matcher gives them for it: they belong to the place that
    the close-up shows."""
    detail = runs.detail
    if detail is None or run != 0:
        return np.empty((0, 2)), np.empty(0)
    mine = detail.candidate_batch == batch
    last = mine & (detail.candidate_scan == detail.candidate_scan.max(initial=-1))
    mine = last if last.any() else mine
    position = np.stack(
        [detail.candidate_latitude[mine], detail.candidate_longitude[mine]], axis=1
    )
    offset = position - centre
    offset[:, 1] = np.remainder(offset[:, 1] + math.pi, 2.0 * math.pi) - math.pi
    return offset * metres, detail.candidate_weight[mine]


def _half_width(runs: Runs, run: int, batch: int, candidates: Array) -> float:
    """m from the centre to the close-up's edge: what the batch and the navigator claim, and where
    they err to, fits in."""
    covariances = [runs.posterior_covariance[run, batch], runs.fix_covariance[run, batch]]
    errors = [runs.posterior_error[run, batch], runs.fix_error[run, batch]]
    reaches = [200.0]
    for error, covariance in zip(errors, covariances, strict=True):
        reach = float(
            np.abs(error).max() + 3.2 * math.sqrt(max(covariance[0, 0], covariance[1, 1]))
        )
        if math.isfinite(reach):
            reaches.append(reach)
    near = np.abs(candidates).max(axis=1, initial=0.0)
    near = near[near <= 4.0 * max(reaches)]  # candidates far out would hide what the batch says
    return style.nice_limit(min(max([*reaches, *(1.05 * near)]), 2e4))


def _relative_track(
    runs: Runs, time: float, error: Array, latitude: float, longitude: float, metres: Array
) -> tuple[Array, Array]:
    """North and east (m) from the centre of truth plus error, ten minutes round the batch end."""
    near = np.abs(runs.time - time) <= 600.0
    north = (runs.latitude[near] - latitude) * metres[0] + error[near, 0]
    east = (np.unwrap(runs.longitude)[near] - longitude) * metres[1] + error[near, 1]
    return north, east


def _line(panel: "Axes", track: tuple[Array, Array], line: style.Line) -> None:
    panel.plot(track[1] / 1e3, track[0] / 1e3, **line.options())


def _ellipse(
    panel: "Axes", centre: Array, covariance: Array, line: style.Line, label: str
) -> None:
    """Draw the 3-sigma ellipse of a north-east covariance (m²)."""
    if not (np.isfinite(centre).all() and np.isfinite(covariance).all()):
        return
    values, vectors = np.linalg.eigh(covariance)
    if values[0] < 0.0:
        return
    angle = np.linspace(0.0, 2.0 * math.pi, 90)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    edge = centre + 3.0 * (circle * np.sqrt(values)) @ vectors.T
    panel.plot(edge[:, 1] / 1e3, edge[:, 0] / 1e3, **line.options(), label=label)
