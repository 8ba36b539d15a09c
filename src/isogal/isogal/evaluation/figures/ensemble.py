"""RMS errors of many runs over time: aided, unaided, bound, and side by side for several
studies."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.figures import style
from isogal.evaluation.records import Runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One curve of RMS error over time."""

    label: str
    time: Array
    """(K,) s since the start."""
    rms: Array
    """(K,) m; NaN = none."""
    line: style.Line | None = None
    """None = the next of the series."""


def ensemble_rms(horizontal_error: Array) -> Array:
    """(K,) RMS over the runs of (R, K) horizontal errors."""
    return np.sqrt(np.mean(horizontal_error**2, axis=0))


def aided_curve(runs: Runs, label: str = "aided", line: style.Line | None = None) -> Curve:
    """RMS horizontal error of the aided navigators."""
    return Curve(label, runs.elapsed, ensemble_rms(runs.horizontal_error), line)


def unaided_curve(
    runs: Runs, label: str = "unaided INS", line: style.Line | None = style.UNAIDED
) -> Curve:
    """RMS horizontal error of the unaided navigators."""
    return Curve(label, runs.elapsed, ensemble_rms(runs.unaided_horizontal_error), line)


@style.journal
def rms_figure(
    curves: Sequence[Curve],
    *,
    logarithmic: bool = True,
    title: str | None = None,
    label: str = "RMS position error (m)",
) -> "Figure":
    """RMS position error over time, any number of curves (paper figs. 52, 56, 56b, 61, 61a).

    Parameters
    ----------
    curves : sequence of Curve
        At least one.
    logarithmic : bool
        Logarithmic error axis: a bound of metres and a drift of kilometres in one picture. Linear
        as in the paper otherwise.
    title : str, optional
        Above the panel.
    label : str
        Of the error axis.
    """
    figure = style.new_figure(3.5)
    panel = figure.subplots()
    lines = style.series(curve.line for curve in curves)
    for curve in curves:
        line = curve.line or next(lines)
        panel.plot(style.hours(curve.time), curve.rms, **line.options(), label=curve.label)
    end = max(float(style.hours(curve.time[-1:])[0]) for curve in curves)
    if logarithmic:
        style.logarithmic(panel)
    else:
        panel.set_ylim(bottom=0.0)
    panel.set_ylabel(label)
    if title:
        panel.set_title(title, loc="left")
    style.time_axis(panel, end)
    style.legend_below(figure, columns=3)
    return figure


def ensemble_figure(
    runs: Runs, bound_rms: Array | None = None, title: str | None = None
) -> "Figure":
    """RMS error of the aided and unaided navigators over time with the posterior Cramér–Rao bound
    at `runs.time`."""
    curves = [unaided_curve(runs), aided_curve(runs, line=style.AIDED)]
    if bound_rms is not None:
        curves.append(
            Curve("posterior Cramér–Rao bound (RMS)", runs.elapsed, bound_rms, style.BOUND)
        )
    many = len(runs) > 1
    label = f"RMS position error of {len(runs)} runs (m)" if many else "position error (m)"
    return rms_figure(curves, title=title, label=label)
