"""Errors of a navigator over time, and whether its covariance agrees with them."""

from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.consistency import chi_square_interval, mean_nees
from isogal.evaluation.figures import style
from isogal.evaluation.records import Runs
from isogal.evaluation.summary import posterior_nees

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@style.journal
def error_figure(runs: Runs) -> "Figure":
    """North and east error of the first run with its 3-sigma band and the fixes; left against the
    unaided INS, right enlarged."""
    figure = style.new_figure(4.6)
    axes = figure.subplots(2, 2, sharex=True)
    time = style.hours(runs.elapsed)
    fix_time = style.hours(runs.fix_time - runs.time[0])
    deviation = 3.0 * np.sqrt(np.diagonal(runs.covariance[0], axis1=1, axis2=2))
    close = _enlarged_limit(runs.error[0], deviation, runs.elapsed)
    for axis, name in enumerate(("North", "East")):
        for column in range(2):
            panel = axes[axis, column]
            panel.axhline(0.0, color="0.5", linewidth=0.6)
            label = r"$\pm3\sigma$ of the navigator"
            band = -deviation[:, axis], deviation[:, axis]
            panel.fill_between(time, *band, **style.BAND, label=label)
            unaided = runs.unaided_error[0, :, axis]
            panel.plot(time, unaided, **style.UNAIDED.options(), label="unaided INS")
            panel.plot(time, runs.error[0, :, axis], **style.AIDED.options(), label="aided")
            if column == 1:
                _fix_marks(panel, fix_time, runs, axis)
                panel.set_ylim(-close, close)
        axes[axis, 0].set_ylabel(f"{name} error (m)")
    axes[0, 0].set_title("against the unaided INS", loc="left")
    axes[0, 1].set_title("enlarged, with the fixes", loc="left")
    for panel in axes[1]:
        style.time_axis(panel, float(time[-1]))
    style.legend_below(figure)
    return figure


def _fix_marks(panel: "Axes", fix_time: Array, runs: Runs, axis: int) -> None:
    error = runs.fix_error[0, :, axis]
    sigma = np.sqrt(runs.fix_covariance[0, :, axis, axis])
    few = min(60.0 / max(len(fix_time), 1), 1.0)
    panel.errorbar(
        *(fix_time, error, sigma),
        fmt="o",
        markersize=1.6 + few,
        color=style.VERMILION,
        ecolor=(0.45, 0.45, 0.45, 0.2 + 0.8 * few),  # many would hide the lines
        elinewidth=0.3 + 0.4 * few,
        zorder=1.6,
        label=r"fixes $\pm1\sigma$",
        markeredgewidth=0.0,
    )


def _enlarged_limit(error: Array, deviation: Array, elapsed: Array) -> float:
    """Half height (m) of the enlarged panels: what band and error reach in the second half of the
    run, when the aiding has settled."""
    settled = elapsed >= 0.5 * elapsed[-1]
    reach = np.maximum(np.abs(error), deviation)[settled]
    return style.nice_limit(1.2 * float(np.nanpercentile(reach, 99.0)))


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
        panel.set_title(
            f"mean {overall:.2f}; 95% interval {low:.2f} to {high:.2f}",
            loc="left",
        )
    style.logarithmic(panel)
    low, high = panel.get_ylim()
    panel.set_ylim(max(min(low, 0.1), 1e-2), max(high, 10.0))
    panel.set_ylabel("NEES per axis (1)")
    style.time_axis(panel, float(style.hours(runs.elapsed[-1:])[0]))
    style.legend_below(figure)
    return figure
