"""Figures of maps: values, gradient, the expected accuracy of fixes along a track, and
navigability."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.figures import style
from isogal.evaluation.figures.track import Frame
from isogal.maps.field_map import FieldMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from isogal.evaluation.navigability.area import Navigability
    from isogal.maps.expected_accuracy import Stretches
    from isogal.maps.tiled_map import ScalarMap

_ACCURACY = 2.1
"""in, height of the panel of accuracies."""
_TALLEST = 4.4
"""in, largest height of a map."""
_WIDE = 0.4
"""Height over width below which the two maps stand one above the other."""
_AROUND, _BELOW = 1.32, 0.85
"""in, room for labels and colour bar beside a map, and for title and labels above and below."""
_FINEST = 330
"""Nodes of a map drawn along each side: the figure has no more pixels for them."""


@style.journal
def map_figure(
    field_map: "ScalarMap",
    track: tuple[Array, Array] | None = None,
    stretches: "Stretches | None" = None,
) -> "Figure":
    """Draw a map and its gradient; with a track, also the expected accuracy of fixes along it.

    Parameters
    ----------
    field_map : FieldMap or TiledMap
    track : (K,), (K,) rad, optional
        Latitude and longitude.
    stretches : Stretches, optional
        Of the track.
    """
    shown = field_map.overview(_FINEST)
    frame = Frame.whole(shown)
    above = frame.shape < _WIDE
    wide = style.WIDTH - _AROUND if above else 0.5 * style.WIDTH - _AROUND
    tall = (2 if above else 1) * (min(wide * frame.shape, _TALLEST) + _BELOW)
    figure = style.new_figure(tall + (_ACCURACY if stretches is not None else 0.0))
    top, bottom = figure, None
    if stretches is not None:
        ratios = (tall, _ACCURACY)
        top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=ratios)[:, 0]
    panels = top.subplots(*((2, 1) if above else (1, 2)), sharex=True, sharey=True)
    frame.draw(panels[0], shown, titled=True)
    steep, label = _gradient(field_map, shown)
    frame.draw(panels[1], steep, label, titled=True)
    for axes in panels:
        axes.label_outer()  # beside the other map, or above it, they are the same
        if track is not None:
            _track(axes, track, shown)
    if stretches is not None and bottom is not None:
        _accuracy(bottom.subplots(), stretches)
    return figure


def _gradient(field_map: "ScalarMap", shown: FieldMap) -> tuple[FieldMap, str]:
    """Return the magnitude of the gradient at the nodes of a map as it is drawn, and its name with
    the unit."""
    factor, unit = 1e3, f"{field_map.unit} per km"
    if field_map.unit == "m/s²":
        factor, unit = 1e3 / style.MGAL, "$10^{-5}$ m/s² per km"
    steep = np.full(shown.values.shape, np.nan)
    known = np.nonzero(np.isfinite(shown.values))  # of a tiled map nothing else is read
    places = shown.latitude[known[0]], shown.longitude[known[1]]
    _, north, east = field_map.value_and_gradient(*places)
    steep[known] = factor * np.hypot(north, east)
    return replace(shown, values=steep, unit=unit), f"Size of the gradient ({unit})"


def _track(axes: "Axes", track: tuple[Array, Array], field_map: FieldMap) -> None:
    """Draw the track, and a dot where it begins."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.6, foreground="black")]
    middle = 0.5 * (field_map.longitude[0] + field_map.longitude[-1])
    turned = np.unwrap(track[1])
    turned += 2.0 * np.pi * np.round((middle - turned.mean()) / (2.0 * np.pi))
    latitude, longitude = np.degrees(track[0]), np.degrees(turned)
    axes.plot(longitude, latitude, color="white", linewidth=1.2, path_effects=halo)
    axes.plot(longitude[0], latitude[0], "o", color="white", markeredgecolor="black")


def _accuracy(axes: "Axes", stretches: "Stretches") -> None:
    """Draw the expected 1-sigma of a fix from each stretch, best and worst direction."""
    best, worst = stretches.axes
    edges = np.r_[stretches.start, stretches.end[-1]] / 1e3
    for values, line, label in (
        (worst, style.SERIES[0], "worst direction"),
        (best, style.SERIES[1], "best direction"),
    ):
        shown = np.where(np.isfinite(values), values, np.nan)
        axes.stairs(shown, edges, baseline=None, label=label, **line.options())
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xlabel("distance along the track (km)")
    length = float(np.median(stretches.end - stretches.start)) / 1e3
    axes.set_ylabel(f"1-sigma of a fix\nfrom {length:.3g} km (m)")
    if np.isfinite(worst).any():
        style.logarithmic(axes)
    style.legend_below(axes.figure, 2)


@style.journal
def navigability_figure(found: "Navigability") -> "Figure":
    """Draw four heat maps of an area."""
    titles = {
        "error_mean": "RMS error on arrival (m)",
        "error_worst": "on the worst heading (m)",
        "ambiguity": "probability of a second place",
        "variability": None,
    }
    layers = {
        name: FieldMap(found.latitude, found.longitude, grid, unit, name)
        for name, (grid, unit, _) in found.layers().items()
        if name in titles
    }
    frame = Frame.whole(layers["error_mean"])
    tall = 2.0 * style.WIDTH * 0.42 * frame.shape + 0.9
    figure = style.new_figure(min(max(tall, 3.0), 8.0))
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    mean, worst = layers["error_mean"].values, layers["error_worst"].values
    errors = float(np.nanquantile(mean, 0.01)), float(np.nanquantile(worst, 0.99))
    limits = {
        "error_mean": errors,
        "error_worst": errors,
        "ambiguity": (0.0, max(float(np.nanmax(found.ambiguity)), 0.01)),
    }
    for panel, (name, title) in zip(panels.flat, titles.items(), strict=True):
        frame.draw(panel, layers[name], title, limits.get(name), titled=True)
        panel.label_outer()
    return figure
