"""The paper's figures, drawn from what was measured here: maps and the map lookup, errors over
time, signals and iterations."""

from typing import TYPE_CHECKING, Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style
from isogal.evaluation.figures.errors import Curve, draw_curves, rms_figure
from isogal.evaluation.figures.signal import variability_along
from isogal.evaluation.figures.track import Frame, image_edges
from isogal.maps.field_map import FieldMap
from isogal.paper.cases import DEFAULT, MATCHERS, PAPER, Plan, Setting
from isogal.paper.iterations import Snapshot
from isogal.paper.lookups import PROFILE_WINDOW, ProfileExample, WindowExample
from isogal.paper.measure import Results
from isogal.paper.published import FIGURE_54_SIDE, FIGURE_64_SCAN, HIGH, LOW

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GRADE_LABELS = {"precision": "PCAG", "quantum_accelerometer": "QAPCG", "quantum": "quantum"}
_LINES = {PAPER: style.Line(style.PURPLE, (0, (5, 1.5, 1, 1.5)), 1.5), DEFAULT: style.AIDED}
_RMS = "RMS position error (m)"


def _dot(marker: str, colour: str, size: float) -> dict[str, Any]:
    """Options of Axes.plot for places, with a black edge."""
    edge = {"markeredgecolor": "black", "markeredgewidth": 0.6}
    return {"marker": marker, "color": colour, "markersize": size, "linestyle": "", **edge}


_TRUTH = _dot("*", style.GREEN, 12)


@style.journal
def map_figure(plan: Plan, quantity: str) -> "Figure":
    """The map with the vehicle's track, marked every half hour (figs. 51, 57)."""
    setting = Setting(quantity=quantity)
    trajectory = plan.trajectory(setting)
    latitude, longitude = trajectory.latitude, np.unwrap(trajectory.longitude)
    frame = Frame.around(latitude, longitude, 5e3)
    figure = style.new_figure(frame.height + 0.3)
    panel = figure.subplots()
    frame.draw(panel, plan.field_map(setting))
    track = np.degrees(longitude), np.degrees(latitude)
    panel.plot(*track, color="white", linewidth=3.4)
    panel.plot(*track, color="black", linewidth=1.5, label="track")
    half_hours = np.arange(0.0, trajectory.time[-1] + 1.0, 1800.0)
    marks = [np.interp(half_hours, trajectory.time, along) for along in track]
    panel.plot(*marks, **_dot("o", style.ORANGE, 4.5), label="every 30 min")
    panel.plot(track[0][0], track[1][0], **_dot("^", "white", 8), label="start")
    style.legend_below(figure)
    return figure


@style.journal
def lookup_1d_figure(example: ProfileExample, field_map: FieldMap) -> "Figure":
    """Profile of the gravity map across the track with a reading and the places in the window that
    it may come from (fig-54a)."""
    scale, sigma = style.field_scale(field_map), LOW["gravity"]
    reading, centre = example.reading, example.centre / 1e3
    km, window = example.offset / 1e3, PROFILE_WINDOW / 1e3

    def at(place: Array | float) -> Array:
        return scale(np.interp(place, example.offset, example.profile))

    figure = style.new_figure(3.4)
    panel = figure.subplots()
    band = scale([reading - sigma, reading + sigma])
    for shaded in (
        panel.axvspan(centre - window, centre + window, color="0.92", label="search window"),
        panel.axhspan(*band, color=style.SKY, alpha=0.5, label=r"reading $s \pm \sigma$"),
    ):
        shaded.set(linewidth=0, zorder=0)
    panel.plot(km, scale(example.profile), **style.TRUTH.options(), label="map")
    panel.axvline(centre, **style.UNAIDED.options(), label=r"prior $x^s$")
    panel.plot(0.0, at(0.0), **_TRUTH, label="truth")
    places = example.candidates / 1e3
    panel.plot(places, at(example.candidates), **_dot("o", style.ORANGE, 6), label="candidates")
    for number, place in enumerate(places, start=1):
        at_reading = place, float(scale(reading))
        panel.annotate(
            f"$x_{number}$", at_reading, xytext=(0, 8), textcoords="offset points", ha="center"
        )
    ends = float(km[0]), float(km[-1])
    panel.set(xlim=ends, xlabel="east of the true place (km)", ylabel=scale.two_lines)
    style.legend_below(figure, columns=6)
    return figure


@style.journal
def search_window_figure(example: WindowExample, field_map: FieldMap) -> "Figure":
    """Search window of 5 x 5 km with 50 candidates, the true place and the PDA solution
    (fig-54)."""
    figure = style.new_figure(4.4)
    panel = figure.subplots()
    scale, metres = style.field_scale(field_map), metres_per_radian(example.latitude)
    lattice = np.linspace(-0.6, 0.6, 90) * FIGURE_54_SIDE
    latitude = example.latitude + lattice[:, None] / metres[0]
    values = scale(field_map.value(latitude, example.longitude + lattice / metres[1]))
    km, edges = lattice / 1e3, image_edges(lattice / 1e3)
    image = panel.imshow(values, extent=(*edges, *edges), origin="lower", cmap=style.FIELD_COLOURS)
    label = f"{scale.name} {scale.unit_label}"
    figure.colorbar(image, ax=panel, label=label, shrink=0.9)
    level = float(scale(example.reading))
    panel.contour(km, km, values, levels=[level], colors="white", linewidths=1.2)
    square = 0.5 * FIGURE_54_SIDE / 1e3 * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])
    panel.plot(*square, color="white", linestyle="--", linewidth=1.4)
    label = f"{len(example.weight)} candidates (size: weight)"
    size = 14.0 + 60.0 * example.weight / example.weight.max()
    north, east = example.candidates.T / 1e3
    dots = panel.scatter(east, north, s=size, color=style.ORANGE, label=label)
    dots.set(edgecolors="black", linewidths=0.5)
    panel.plot(0.0, 0.0, **_dot("P", "white", 8), label="prior (centre)")
    panel.plot(*example.truth[::-1] / 1e3, **_TRUTH, label="truth")
    panel.plot(*example.combined[::-1] / 1e3, **_dot("D", "black", 6), label="PDA solution")
    panel.grid(False)
    panel.set(xlabel="east (km)", ylabel="north (km)")
    style.legend_below(figure)
    return figure


def overview_figure(results: Results) -> "Figure":
    """RMS errors of the unaided INS by grade and of the aided one by map (fig-52)."""
    unaided = (
        style.Line(style.VERMILION, "-", 2.6),
        style.Line(style.BLACK, (0, (4, 3)), 1.4),
        style.Line(style.ORANGE, (0, (1, 2)), 2.0),
    )
    curves = []
    for (grade, name), line in zip(GRADE_LABELS.items(), unaided, strict=True):
        outcome = results.unaided(grade)
        curves.append(Curve(f"unaided, {name}", outcome.time, outcome.unaided_rms, line))
    for matcher, colour in ((PAPER, style.PURPLE), (DEFAULT, style.BLUE)):
        for quantity, dashes, width in (
            ("gravity", "-", 1.5),
            ("disturbance", (0, (3, 1.2)), 1.3),
        ):
            outcome = results.at(quantity, LOW[quantity], 30, matcher)
            line = style.Line(colour, dashes, width)
            curves.append(Curve(f"{matcher}, {quantity}", outcome.time, outcome.rms, line))
    return rms_figure(curves, _RMS)


@style.journal
def noise_figure(results: Results, quantity: str, batch_length: int) -> "Figure":
    """RMS errors at both noise levels for one map and batch length (figs. 56, 56b, 61, 61a), with
    the bound."""
    figure = style.new_figure(3.3)
    panels = figure.subplots(1, 2, sharey=True)
    for panel, sigma in zip(panels, (LOW[quantity], HIGH[quantity]), strict=True):
        paper, default = (results.at(quantity, sigma, batch_length, m) for m in MATCHERS)
        curves = [
            Curve("unaided INS", paper.time, paper.unaided_rms, style.UNAIDED),
            Curve(PAPER, paper.time, paper.rms, _LINES[PAPER]),
            Curve(DEFAULT, default.time, default.rms, _LINES[DEFAULT]),
            Curve("posterior Cramér–Rao bound", paper.time, paper.bound, style.BOUND),
        ]
        draw_curves(panel, curves)
        style.logarithmic(panel)
        panel.set_title(rf"$\sigma$ = {sigma:g} m/s², T = {batch_length}", loc="left")
    panels[0].set_ylabel(_RMS)
    style.legend_below(figure)
    return figure


@style.journal
def readings_figure(results: Results) -> "Figure":
    """Gravity readings of one run at each noise level, and their differences to the noiseless
    signal (fig-56a)."""
    scale = style.field_scale(results.plan.field_map(Setting()))
    figure = style.new_figure(4.4)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    looks = {HIGH["gravity"]: (style.ORANGE, ".", 3.2), LOW["gravity"]: (style.BLUE, "+", 3.4)}
    for sigma, (colour, marker, size) in looks.items():
        detail = results.at("gravity", sigma, 30).detail
        assert detail is not None  # run 0 is among the runs
        time, label = style.hours(detail.scan_time), rf"$\sigma$ = {sigma:g} m/s²"
        difference = (detail.reading - detail.map_value) / scale.unit
        for panel, values in ((top, scale(detail.reading)), (bottom, difference)):
            panel.plot(time, values, marker, color=colour, markersize=size, label=label)
    signal = results.signal["gravity"]
    time, noiseless = style.hours(signal.time), scale(signal.signal)
    top.plot(time, noiseless, **style.TRUTH.options(), label=r"$\sigma$ = 0")
    top.set_ylabel(scale.two_lines)
    bottom.axhline(0.0, **style.TRUTH.options())
    bottom.set_ylabel("difference\n" + scale.unit_label)
    style.time_axis(bottom, float(time[-1]))
    style.legend_below(figure, columns=3)
    return figure


@style.journal
def variability_figure(results: Results) -> "Figure":
    """Noiseless gravity disturbance along the track and the map feature variability there
    (fig-60)."""
    field_map = results.plan.field_map(Setting(quantity="disturbance"))
    signal = results.signal["disturbance"]
    time, curves = style.hours(signal.time), (signal.variability, signal.normalised)
    figure = variability_along(field_map, time, signal.signal, *curves)
    style.time_axis(figure.axes[-1], float(time[-1]))
    return figure


@style.journal
def iterations_figure(results: Results) -> "Figure":
    """One batch from the navigator's track over the iterations to the fix, on the candidates
    (fig-64); right: all batches of the run."""
    figure = style.new_figure(4.3)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _one_batch(left, min(results.snapshots, key=lambda s: abs(s.time - FIGURE_64_SCAN)))
    movement = np.array([snapshot.movement for snapshot in results.snapshots])
    count = np.arange(1, movement.shape[1] + 1)
    low, median, high = np.percentile(movement, [10.0, 50.0, 90.0], axis=0)
    label = f"10 to 90 % of {len(movement)} batches"
    right.fill_between(count, low, high, color=style.SKY, alpha=0.35, linewidth=0, label=label)
    right.plot(count, median, **style.AIDED.options(), marker="o", markersize=3, label="median")
    right.set(yscale="log", xlabel="iteration", ylabel="movement of the batch (m)")
    right.legend(loc="upper right")
    style.legend_below(figure, columns=3, panels=[left])
    return figure


def _one_batch(panel: "Axes", shot: Snapshot) -> None:
    """Draw the iterates of a batch's track, the candidates and the true track."""
    states, truth = shot.states / 1e3, shot.truth / 1e3
    size = 8.0 + 40.0 * shot.weight / max(float(shot.weight.max()), 1e-300)
    north, east = shot.candidates.T / 1e3
    crosses = panel.scatter(east, north, s=size, marker="+", color=style.BLUE)
    crosses.set(linewidths=0.8, label="candidates (size: weight)")
    for number, track in enumerate(states[1:-1]):
        label = "iterations between" if number == 0 else ""
        panel.plot(*track.T[::-1], color="0.55", linewidth=0.6, label=label)
    panel.plot(*truth.T[::-1], "-", color=style.GREEN, linewidth=2.0, label="truth")
    (start,) = panel.plot(*states[0].T[::-1], "o", color=style.PURPLE, label="navigator")
    start.set(markersize=5.5, markerfacecolor="none")
    last = f"after {len(states) - 1} iterations"
    panel.plot(*states[-1].T[::-1], "*", markersize=7.0, color="black", label=last)
    path = np.concatenate([truth, states.reshape(-1, 2)])
    centre = 0.5 * (path.min(axis=0) + path.max(axis=0))
    half = 0.5 * float(np.ptp(path, axis=0).max()) + 0.9
    (south, west), (north, east) = centre - half, centre + half
    panel.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    panel.set(xlabel="east of the last scan (km)", ylabel="north of the last scan (km)")
    panel.set_title(f"batch that ends at {shot.time:.0f} s", loc="left")
