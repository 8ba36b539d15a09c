"""RMS errors of many runs over time: aided, unaided, and the bound."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.figures import style
from isogal.evaluation.records import Runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    """RMS position error over time, any number of curves (paper fig. 52).

    The error axis is logarithmic: a bound of metres and a drift of kilometres share it.

    Parameters
    ----------
    curves : sequence of Curve
        At least one.
    label : str
        Of the error axis.
    """
    figure = style.new_figure(3.5)
    panel = figure.subplots()
    draw_curves(panel, curves)
    style.logarithmic(panel)
    panel.set_ylabel(label)
    style.legend_below(figure, columns=3)
    return figure


def draw_curves(panel: "Axes", curves: Sequence[Curve]) -> None:
    """Draw curves over the time of the longest."""
    for curve in curves:
        panel.plot(style.hours(curve.time), curve.rms, **curve.line.options(), label=curve.label)
    style.time_axis(panel, max(float(style.hours(curve.time[-1:])[0]) for curve in curves))


def ensemble_figure(
    runs: Runs, bound_rms: Array, smoothed_bound_rms: Array | None = None
) -> "Figure":
    """RMS error of the unaided and the aided navigators over time, with the posterior Cramér–Rao
    bound (K,) m at `runs.time`; of runs that were smoothed also that of the smoothed states, with
    the bound of one that knows all readings."""
    bound = "posterior Cramér–Rao bound (RMS)"
    curves = [
        Curve("unaided INS", runs.elapsed, _rms(runs.unaided_horizontal_error), style.UNAIDED),
        Curve("aided", runs.elapsed, _rms(runs.horizontal_error), style.AIDED),
        Curve(bound, runs.elapsed, bound_rms, style.BOUND),
    ]
    if runs.smoothed is not None:
        error = _rms(runs.smoothed.horizontal_error)
        curves.append(Curve("smoothed", runs.elapsed, error, style.SMOOTHED))
        if smoothed_bound_rms is not None:
            label = "bound of smoothing (RMS)"
            curves.append(Curve(label, runs.elapsed, smoothed_bound_rms, style.SMOOTHED_BOUND))
    many = len(runs) > 1
    label = f"RMS position error of {len(runs)} runs (m)" if many else "position error (m)"
    return rms_figure(curves, label)


def _rms(horizontal_error: Array) -> Array:
    """(K,) RMS over the runs of (R, K) horizontal errors."""
    return np.sqrt(np.mean(horizontal_error**2, axis=0))
