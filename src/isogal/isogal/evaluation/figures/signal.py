"""Readings along the track, and how much the map varies there."""

from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.figures import style
from isogal.evaluation.records import Runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from isogal.maps.tiled_map import ScalarMap

_DOTS = {"linestyle": "none", "marker": ".", "markersize": 2.0, "color": style.VERMILION}
"""Of readings."""


@style.journal
def signal_figure(runs: Runs, field_map: "ScalarMap", sigma: float) -> "Figure":
    """Measured values against the map's at the true and at the navigated position, and their
    differences below.

    Parameters
    ----------
    runs : Runs
        With a detail.
    field_map : ScalarMap
        Gives unit and name of the field.
    sigma : float
        1-sigma of a reading's white noise, drawn as a band.
    """
    detail = runs.detail
    if detail is None:
        raise ValueError("this figure needs a record with detail (a single run)")
    scale = style.field_scale(field_map)
    figure = style.new_figure(4.2)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    time = style.hours(detail.scan_time - runs.time[0])
    for values, line, label in (
        (detail.reading, _DOTS, "measured"),
        (detail.map_value, style.TRUTH.options(), "map, true position"),
        (detail.map_value_navigator, style.SERIES[2].options(), "map, navigator"),
    ):
        top.plot(time, scale(values), **line, label=label)
    top.set_ylabel(scale.two_lines)

    band = 3.0 * sigma / scale.unit
    bottom.axhspan(-band, band, **style.BAND, label=r"$\pm3\sigma$ of the noise")
    for value, line, where in (
        (detail.map_value, _DOTS, "true position"),
        (detail.map_value_navigator, style.Line(style.GREEN, "-", 0.8).options(), "navigator"),
    ):
        difference = (detail.reading - value) / scale.unit
        bottom.plot(time, difference, **line, label=f"measured − map, {where}")
    bottom.set_ylabel("difference\n" + scale.unit_label)
    style.time_axis(bottom, style.hours(runs.elapsed[-1]))
    style.legend_below(figure, columns=3)
    return figure


@style.journal
def variability_along(
    field_map: "ScalarMap", along: Array, value: Array, variability: Array, normalised: Array
) -> "Figure":
    """Draw the map's values along a track, and below them the map feature variability (paper fig.
    60). What the horizontal axis says is left to the caller.

    Parameters
    ----------
    field_map : ScalarMap
        Gives unit and name of the field.
    along : (K,) array
        On the horizontal axis.
    value : (K,) array
        Of the map.
    variability : (K,) array
        C, unit squared; drawn as its root.
    normalised : (K,) array
        C normalised.
    """
    scale = style.field_scale(field_map)
    figure = style.new_figure(4.4)
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    root = np.sqrt(variability) / scale.unit
    for panel, curve, label, line in (
        (panels[0], scale(value), scale.two_lines, style.TRUTH),
        (panels[1], root, f"root of feature\nvariability\n{scale.unit_label}", style.AIDED),
        (panels[2], normalised, "normalised\nvariability (1)", style.SERIES[2]),
    ):
        panel.plot(along, curve, **line.options())
        panel.set_ylabel(label)
    for panel in panels[1:]:
        panel.set_ylim(bottom=0.0)
    panels[2].axhline(1.0, color="0.4", linewidth=0.8)
    panels[2].set_xlim(float(along[0]), float(along[-1]))
    figure.align_ylabels(panels)
    return figure
