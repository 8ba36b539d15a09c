"""What the sensor reads, how much the map varies, and how the iterations move (paper figs. 56a,
60, 64)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from isogal.evaluation.figures import style
from isogal.paper.cases import Setting
from isogal.paper.iterations import Snapshot
from isogal.paper.published import FIGURE_64_SCAN, HIGH, LOW
from isogal.paper.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
        time = style.hours(detail.scan_time)
        label = rf"$\sigma$ = {sigma:g} m/s²"
        top.plot(time, scale(detail.reading), marker, color=colour, markersize=size, label=label)
        difference = (detail.reading - detail.map_value) / scale.unit
        bottom.plot(time, difference, marker, color=colour, markersize=size)
    signal = results.signal["gravity"]
    top.plot(
        style.hours(signal.time),
        scale(signal.signal),
        **style.TRUTH.options(),
        label=r"$\sigma$ = 0",
    )
    top.set_ylabel(scale.label.replace(" (", "\n(", 1))
    bottom.axhline(0.0, **style.TRUTH.options())
    bottom.set_ylabel("difference\n(" + scale.label.rsplit("(", 1)[1])
    style.time_axis(bottom, float(style.hours(signal.time[-1:])[0]))
    figure.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


@style.journal
def variability_figure(results: Results) -> "Figure":
    """Noiseless gravity disturbance along the track and the map feature variability there
    (fig-60)."""
    scale = style.field_scale(results.plan.field_map(Setting(quantity="disturbance")))
    signal = results.signal["disturbance"]
    figure = style.new_figure(4.2)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    time = style.hours(signal.time)
    top.plot(time, scale(signal.signal), **style.TRUTH.options())
    top.set_ylabel(scale.label.replace(" (", "\n(", 1))
    middle.plot(time, np.sqrt(signal.variability) / scale.unit, **style.AIDED.options())
    middle.set_ylim(bottom=0.0)
    middle.set_ylabel(r"$\sqrt{C_i}$" + "\n(" + scale.label.rsplit("(", 1)[1])
    bottom.plot(time, signal.normalised, **style.SERIES[2].options())
    bottom.set_ylim(bottom=0.0)
    bottom.set_ylabel("normalised\n$C_i$ (1)")
    style.time_axis(bottom, float(time[-1]))
    return figure


@style.journal
def iterations_figure(results: Results) -> "Figure":
    """One batch from the navigator's track over the iterations to the fix, on the candidates
    (fig-64); right: all batches of the run."""
    figure = style.new_figure(4.3)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _one_batch(left, min(results.snapshots, key=lambda s: abs(s.time - FIGURE_64_SCAN)))
    _movement(right, results.snapshots)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _one_batch(panel: "Axes", shot: Snapshot) -> None:
    """Draw the iterates of a batch's track, the candidates and the true track."""
    candidates, states, truth = shot.candidates / 1e3, shot.states / 1e3, shot.truth / 1e3
    panel.scatter(
        candidates[:, 1],
        candidates[:, 0],
        s=8.0 + 40.0 * shot.weight / max(float(shot.weight.max()), 1e-300),
        marker="+",
        color=style.BLUE,
        linewidths=0.8,
        label="candidates (size: weight)",
    )
    for number, track in enumerate(states[1:-1]):
        label = "iterations between" if number == 0 else None
        panel.plot(track[:, 1], track[:, 0], color="0.55", linewidth=0.6, label=label)
    last = f"after {len(states) - 1} iterations"
    panel.plot(truth[:, 1], truth[:, 0], "-", color=style.GREEN, linewidth=2.0, label="truth")
    for track, marker, size, colour, face, label in (
        (states[0], "o", 5.5, style.PURPLE, "none", "navigator"),
        (states[-1], "*", 7.0, "black", "black", last),
    ):
        panel.plot(
            track[:, 1],
            track[:, 0],
            marker,
            color=colour,
            markerfacecolor=face,
            markersize=size,
            label=label,
        )
    path = np.concatenate([truth, states.reshape(-1, 2)])
    centre = 0.5 * (path.min(axis=0) + path.max(axis=0))
    half = 0.5 * float(np.ptp(path, axis=0).max()) + 0.9
    panel.set_xlim(centre[1] - half, centre[1] + half)
    panel.set_ylim(centre[0] - half, centre[0] + half)
    panel.set_aspect("equal")
    panel.set_xlabel("east of the last scan (km)")
    panel.set_ylabel("north of the last scan (km)")
    panel.set_title(f"batch that ends at {shot.time:.0f} s", loc="left")


def _movement(panel: "Axes", snapshots: Sequence[Snapshot]) -> None:
    """Draw how far each iteration moves the batches."""
    movement = np.array([s.movement for s in snapshots])
    count = np.arange(1, movement.shape[1] + 1)
    panel.fill_between(
        count,
        *np.percentile(movement, [10.0, 90.0], axis=0),
        color=style.SKY,
        alpha=0.35,
        linewidth=0,
        label=f"10 to 90 % of {len(snapshots)} batches",
    )
    panel.plot(
        count,
        np.median(movement, axis=0),
        **style.AIDED.options(),
        marker="o",
        markersize=3,
        label="median",
    )
    panel.set_yscale("log")
    panel.set_xlabel("iteration")
    panel.set_ylabel("movement of the batch (m)")
    panel.legend(loc="upper right")
