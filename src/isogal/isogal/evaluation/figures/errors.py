"""Errors of navigators over time, and whether they are what the navigators claim."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.consistency import chi_square_interval, mean_nees
from isogal.evaluation.figures import style
from isogal.evaluation.integrity import level_of, rate_of
from isogal.evaluation.records import Runs
from isogal.evaluation.summary import posterior_nees
from isogal.scenario import Integrity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BINS = 80
"""Of the diagram of Stanford, along either axis."""
_SMALLEST = 1e-3
"""Error in units of the largest value at which its axes begin: smaller ones stand there."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One curve of RMS error over time."""

    label: str
    time: Array
    """(K,) s since the start."""
    rms: Array
    """(K,) m; NaN = none."""
    line: style.Line


@style.journal
def rms_figure(curves: Sequence[Curve], label: str = "RMS position error (m)") -> "Figure":
    """RMS position error over time, any number of curves but none (paper fig. 52), with a label of
    the error's axis.

    That axis is logarithmic: a bound of metres and a drift of kilometres share it."""
    figure = style.new_figure(3.5)
    panel = figure.subplots()
    draw_curves(panel, curves)
    panel.set_ylabel(label)
    style.legend_below(figure, columns=3)
    return figure


def draw_curves(panel: "Axes", curves: Sequence[Curve]) -> None:
    """Draw curves over the time of the longest, on a logarithmic axis."""
    for curve in curves:
        panel.plot(style.hours(curve.time), curve.rms, **curve.line.options(), label=curve.label)
    style.time_axis(panel, max(style.hours(curve.time[-1]) for curve in curves))
    style.logarithmic(panel)


def ensemble_figure(
    runs: Runs, bound_rms: Array, smoothed_bound_rms: Array | None = None
) -> "Figure":
    """RMS error of the unaided and the aided navigators over time, with the posterior Cramér–Rao
    bound (K,) m at `runs.time`; of runs that were smoothed also that of the smoothed states, with
    the bound of one that knows all readings."""
    time, name = runs.elapsed, "posterior Cramér–Rao bound (RMS)"
    curves = [
        Curve("unaided INS", time, runs.unaided_rms, style.UNAIDED),
        Curve("aided", time, runs.rms, style.AIDED),
        Curve(name, time, bound_rms, style.BOUND),
    ]
    if runs.smoothed is not None:
        curves.append(Curve("smoothed", time, runs.smoothed.rms, style.SMOOTHED))
        if smoothed_bound_rms is not None:
            name = "bound of smoothing (RMS)"
            curves.append(Curve(name, time, smoothed_bound_rms, style.SMOOTHED_BOUND))
    many = len(runs) > 1
    label = f"RMS position error of {len(runs)} runs (m)" if many else "position error (m)"
    return rms_figure(curves, label)


@style.journal
def error_figure(runs: Runs) -> "Figure":
    """North and east error of the first run with its 3-sigma band and the fixes; left against the
    unaided INS, right enlarged."""
    figure = style.new_figure(4.6)
    axes = figure.subplots(2, 2, sharex=True)
    time = style.hours(runs.elapsed)
    deviation = 3.0 * np.sqrt(np.diagonal(runs.covariance[0], axis1=1, axis2=2))
    # what band and error reach in the second half, when the aiding has settled
    reach = np.maximum(np.abs(runs.error[0]), deviation)[runs.elapsed >= 0.5 * runs.elapsed[-1]]
    close = style.nice_limit(1.2 * float(np.nanpercentile(reach, 99.0)))
    for axis, name in enumerate(("North", "East")):
        for panel in axes[axis]:
            panel.axhline(0.0, color="0.5", linewidth=0.6)
            label = r"$\pm3\sigma$ of the navigator"
            band = -deviation[:, axis], deviation[:, axis]
            panel.fill_between(time, *band, **style.BAND, label=label)
            unaided = runs.unaided_error[0, :, axis]
            panel.plot(time, unaided, **style.UNAIDED.options(), label="unaided INS")
            panel.plot(time, runs.error[0, :, axis], **style.AIDED.options(), label="aided")
        _fix_marks(axes[axis, 1], runs, axis)
        axes[axis, 1].set_ylim(-close, close)
        axes[axis, 0].set_ylabel(f"{name} error (m)")
    axes[0, 0].set_title("against the unaided INS", loc="left")
    axes[0, 1].set_title("enlarged, with the fixes", loc="left")
    for panel in axes[1]:
        style.time_axis(panel, time[-1])
    style.legend_below(figure)
    return figure


def _fix_marks(panel: "Axes", runs: Runs, axis: int) -> None:
    few = min(60.0 / max(len(runs.fix_time), 1), 1.0)
    panel.errorbar(
        style.hours(runs.fix_time - runs.time[0]),
        runs.fix_error[0, :, axis],
        np.sqrt(runs.fix_covariance[0, :, axis, axis]),
        fmt="o",
        markersize=1.6 + few,
        color=style.VERMILION,
        ecolor=(0.45, 0.45, 0.45, 0.2 + 0.8 * few),  # many would hide the lines
        elinewidth=0.3 + 0.4 * few,
        zorder=1.6,
        label=r"fixes $\pm1\sigma$",
        markeredgewidth=0.0,
    )


@style.journal
def nees_figure(runs: Runs) -> "Figure":
    """NEES per axis right after each published fix (docs/mathematics.md, section 11.3): of the one
    run, or averaged over runs, with its chi-square interval."""
    figure = style.new_figure(2.7)
    panel = figure.subplots()
    time = style.hours(runs.fix_time - runs.time[0])
    values = posterior_nees(runs)
    counts = np.sum(~np.isnan(values), axis=0)
    known = counts > 0
    mean = np.ma.masked_array(values, np.isnan(values)).mean(axis=0).filled(np.nan)
    if known.any():
        band = np.array([chi_square_interval(float(n)) for n in counts[known]])
        label = "95% of consistent navigators"
        panel.fill_between(time[known], *band.T, **style.BAND, label=label)
    who = "this run" if len(runs) == 1 else f"mean of {len(runs)} runs"
    panel.plot(time, mean, **style.AIDED.options(), marker="o", markersize=3, label=who)
    panel.axhline(1.0, **style.BOUND.options(), label="1: right")
    overall, (low, high) = mean_nees(values)
    if np.isfinite(overall):
        text = f"mean {overall:.2f}; 95% interval {low:.2f} to {high:.2f}"
        panel.set_title(text, loc="left")
    style.logarithmic(panel)
    low, high = panel.get_ylim()
    panel.set_ylim(max(min(low, 0.1), 1e-2), max(high, 10.0))
    panel.set_ylabel("NEES per axis (1)")
    style.time_axis(panel, style.hours(runs.elapsed[-1]))
    style.legend_below(figure)
    return figure


@style.journal
def stanford_figure(runs: Runs, settings: Integrity) -> "Figure":
    """Draw how many states have which error and which protection level: the diagram of Stanford
    (docs/integrity.md), with the diagonal and the numbers of the regions that it, and the alert
    limit if there is one, make."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import FuncFormatter, NullFormatter

    level, error = level_of(runs, settings), runs.horizontal_error
    figure = style.new_figure(5.4)
    panel = figure.subplots()
    values = np.concatenate([error.ravel(), level.ravel()])
    largest = values[np.isfinite(values)].max(initial=1.0)
    top = style.nice_limit(1.1 * max(largest, 1.5 * (settings.alert_limit or 0.0)))
    edges = np.geomspace(_SMALLEST * top, top, _BINS + 1)
    across, up = (
        np.clip(np.nan_to_num(one, nan=np.inf), edges[0], edges[-1]).ravel()
        for one in (error, level)
    )
    counts, _, _ = np.histogram2d(across, up, bins=[edges, edges])
    mesh = panel.pcolormesh(
        edges,
        edges,
        np.where(counts > 0, counts, np.nan).T,
        norm=LogNorm(1.0, max(10.0, float(counts.max()))),
        cmap=style.FIELD_COLOURS,
        rasterized=True,
    )
    figure.colorbar(mesh, ax=panel, label="states in a cell (1)", pad=0.02)
    panel.plot(edges[[0, -1]], edges[[0, -1]], **style.TRUTH.options())
    ends = edges[0], edges[-1]
    panel.set(xscale="log", yscale="log", xlim=ends, ylim=ends, aspect="equal")
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    panel.set_xlabel("horizontal error (m)")
    panel.set_ylabel(f"horizontal protection level at {settings.risk:g} per hour (m)")
    _regions(panel, runs, settings, level)
    return figure


def _regions(panel: "Axes", runs: Runs, settings: Integrity, level: Array) -> None:
    """Name the regions where they are, and say above how many states are in them."""
    error, limit = runs.horizontal_error, settings.alert_limit
    places = {"misleading": (0.97, 0.03, ~(error <= level))}
    if limit is not None:
        places["hazardous"] = (0.97, 0.12, (level <= limit) & ~(error <= limit))
        places["not available"] = (0.03, 0.97, ~(level <= limit))
        for line in (panel.axvline, panel.axhline):
            line(limit, **style.BOUND.options())
    lines = []
    for name, (x, y, which) in places.items():
        rate = rate_of(which, runs, settings)
        lines.append(f"{name}: {int(which.sum())} of {which.size} states")
        if y < 0.5:
            lines[-1] += f", {rate.events} events in {rate.hours:.1f} h"
        sides = "right" if x > 0.5 else "left", "top" if y > 0.5 else "bottom"
        placed: style.Options = {"transform": panel.transAxes, "ha": sides[0], "va": sides[1]}
        box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85}
        panel.text(x, y, name, **placed, bbox=box)
    panel.set_title("\n".join(lines), loc="left")
