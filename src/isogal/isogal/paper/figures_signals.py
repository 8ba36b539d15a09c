"""What the sensor reads, how much the map varies, and how the iterations move (paper figs. 56a,
60, 64)."""

from typing import TYPE_CHECKING

import numpy as np

from isogal.evaluation.figures import style
from isogal.paper.cases import Setting
from isogal.paper.published import FIGURE_64_SCAN, HIGH, LOW
from isogal.paper.results import Results

if TYPE_CHECKING:
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
    panel, side = figure.subplots(1, 2, width_ratios=(3, 2))
    snapshots = results.snapshots
    shot = min(snapshots, key=lambda s: abs(s.time - FIGURE_64_SCAN))
    km = 1e-3
    size = 8.0 + 40.0 * shot.weight / max(float(shot.weight.max()), 1e-300)
    panel.scatter(
        shot.candidates[:, 1] * km, shot.candidates[:, 0] * km, s=size, marker="+", color=style.BLUE, linewidths=0.8,
        label="candidates (size: weight)",
    )  # fmt: skip
    for number, states in enumerate(shot.states[1:-1]):
        label = "iterations between" if number == 0 else None
        panel.plot(states[:, 1] * km, states[:, 0] * km, color="0.55", linewidth=0.6, label=label)
    looks = (
        (shot.truth, "-", "none", style.GREEN, "truth"),
        (shot.states[0], "o", style.PURPLE, style.PURPLE, "navigator"),
        (shot.states[-1], "*", "black", "black", f"after {len(shot.states) - 1} iterations"),
    )
    for states, style_, face, colour, label in looks:
        panel.plot(
            states[:, 1] * km, states[:, 0] * km, style_, color=colour, markerfacecolor=face if face == "black" else "none",
            markersize=7 if style_ == "*" else 5.5, linewidth=2.0, label=label,
        )  # fmt: skip
    path = np.concatenate([shot.truth, shot.states.reshape(-1, 2)])
    centre = 0.5 * (path.min(axis=0) + path.max(axis=0)) * km
    half = 0.5 * float(np.ptp(path, axis=0).max()) * km + 0.9
    panel.set_xlim(centre[1] - half, centre[1] + half)
    panel.set_ylim(centre[0] - half, centre[0] + half)
    panel.set_aspect("equal")
    panel.set_xlabel("east of the last scan (km)")
    panel.set_ylabel("north of the last scan (km)")
    panel.set_title(f"batch that ends at {shot.time:.0f} s", loc="left")

    movement = np.array([s.movement for s in snapshots])
    count = np.arange(1, movement.shape[1] + 1)
    side.fill_between(
        count, *np.percentile(movement, [10.0, 90.0], axis=0), color=style.SKY, alpha=0.35, linewidth=0,
        label=f"10 to 90 % of {len(snapshots)} batches",
    )  # fmt: skip
    side.plot(
        count,
        np.median(movement, axis=0),
        **style.AIDED.options(),
        marker="o",
        markersize=3,
        label="median",
    )
    side.set_yscale("log")
    side.set_xlabel("iteration")
    side.set_ylabel("movement of the batch (m)")
    side.legend(loc="upper right")
    figure.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
