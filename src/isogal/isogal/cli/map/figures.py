"""Figures of maps: values, gradient, the expected accuracy of fixes along a track, and
navigability."""

from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from isogal.evaluation.navigability.area import Navigability
    from isogal.maps.expected_accuracy import Stretches
    from isogal.maps.field_map import FieldMap
    from isogal.maps.tiled_map import ScalarMap

_ACCURACY = 2.1
"""in, height of the panel of accuracies."""
_TALLEST = 4.4
"""in, largest height of a map."""
_WIDE = 0.4
"""Height over width below which the two maps stand one above the other."""
_AROUND, _BELOW = 1.32, 0.75
"""in, room for labels and colour bar beside a map, and for title and labels above and below."""
_FINEST = 330
"""Nodes of a map drawn along each side: the figure has no more pixels for them."""


def slope_label(field_map: "ScalarMap") -> tuple[float, str]:
    """Return (factor from unit per m, unit) in which gradients are written."""
    if field_map.unit == "m/s²":
        return 1e8, "$10^{-5}$ m/s² per km"
    return 1e3, f"{field_map.unit} per km"


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
    scale = style.field_scale(field_map)
    factor, unit = slope_label(field_map)
    shown, steep = _shown(field_map)
    steep *= factor
    latitude, longitude = shown.latitude, shown.longitude
    metres_north, metres_east = metres_per_radian(float(latitude.mean()))
    shape = float(np.ptp(latitude) * metres_north / (np.ptp(longitude) * metres_east))
    above = shape < _WIDE
    wide = style.WIDTH - _AROUND if above else 0.5 * style.WIDTH - _AROUND
    tall = (2 if above else 1) * (min(wide * shape, _TALLEST) + _BELOW)
    figure = style.new_figure(tall + (_ACCURACY if stretches is not None else 0.0))
    top, bottom = figure, None
    if stretches is not None:
        ratios = (tall, _ACCURACY)
        top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=ratios)[:, 0]
    panels = top.subplots(*((2, 1) if above else (1, 2)), sharex=True, sharey=True)
    levels = (
        np.nanpercentile(steep, [5, 99.5]) if np.isfinite(steep).any() else np.array([0.1, 1.0])
    )
    at = shown.latitude, shown.longitude
    _field(panels[0], at, scale(shown.values), scale.label, None)
    _field(panels[1], at, steep, f"Size of the gradient ({unit})", levels)
    for axes in panels:
        axes.set(xlabel="longitude (deg)", ylabel="latitude (deg)")
        axes.label_outer()  # beside the other map, or above it, they are the same
        axes.set_aspect(float(metres_north / metres_east))
        if track is not None:
            _track(axes, track, shown, stretches)
    if stretches is not None and bottom is not None:
        _accuracy(bottom.subplots(), stretches)
    return figure


def _shown(field_map: "ScalarMap") -> "tuple[FieldMap, Array]":
    """Return the map as it is drawn, and the magnitude of the gradient at its nodes."""
    shown = field_map.overview(_FINEST)
    steep = np.full(shown.values.shape, np.nan)
    known = np.nonzero(np.isfinite(shown.values))  # of a tiled map nothing else is read
    _, north, east = field_map.value_and_gradient(
        shown.latitude[known[0]], shown.longitude[known[1]]
    )
    steep[known] = np.hypot(north, east)
    return shown, steep


def _field(
    axes: "Axes", at: tuple[Array, Array], values: Array, label: str, levels: Array | None
) -> None:
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator

    latitude, longitude = (np.degrees(axis) for axis in at)
    known = values[np.isfinite(values)]
    norm = Normalize()
    logarithmic = levels is not None and levels[1] > 0.0
    if logarithmic and levels is not None:
        norm = LogNorm(max(levels[0], 1e-3 * levels[1]), levels[1])
    elif known.size:
        norm = Normalize(np.percentile(known, 0.2), np.percentile(known, 99.8))
    picture = axes.pcolormesh(
        longitude,
        latitude,
        np.ma.masked_invalid(values),
        cmap=style.FIELD_COLOURS,
        shading="nearest",
        rasterized=True,
        norm=norm,
    )
    axes.set_facecolor("0.92")
    axes.grid(False)
    # as tall as the map, whose shape is its own
    beside = axes.inset_axes((1.02, 0.0, 0.04, 1.0))
    bar = axes.figure.colorbar(picture, cax=beside, extend="both", extendfrac=0.03)
    axes.set_title(label)
    if logarithmic:
        bar.ax.yaxis.set_major_locator(LogLocator(10, subs=(1, 2, 5)))
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        bar.ax.yaxis.set_minor_locator(LogLocator(10, subs=()))
    axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))


def _track(
    axes: "Axes", track: tuple[Array, Array], field_map: "FieldMap", stretches: "Stretches | None"
) -> None:
    """Draw the track, with a mark every ten stretches."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.6, foreground="black")]
    latitude, longitude = np.degrees(track[0]), np.degrees(_into(track[1], field_map))
    axes.plot(longitude, latitude, color="white", linewidth=1.2, path_effects=halo)
    axes.plot(longitude[0], latitude[0], "o", color="white", markeredgecolor="black")
    if stretches is None:
        return
    middle = 0.5 * (stretches.start + stretches.end)
    spacing = style.nice_limit(float(stretches.end[-1]) / 5.0)
    for mark in np.arange(spacing, float(stretches.end[-1]), spacing):
        nearest = int(np.argmin(np.abs(middle - mark)))
        at = (
            np.degrees(_into(stretches.longitude[nearest : nearest + 1], field_map))[0],
            np.degrees(stretches.latitude[nearest]),
        )
        axes.plot(*at, marker="|", markersize=7, color="white", path_effects=halo)
        axes.annotate(
            f"{mark / 1e3:g} km",
            at,
            xytext=(3, -10),
            textcoords="offset points",
            fontsize=7,
            color="white",
            path_effects=halo,
        )


def _into(longitude: Array, field_map: "FieldMap") -> Array:
    """Return longitudes changed by whole circles such that they lie in the map's range."""
    middle = 0.5 * (field_map.longitude[0] + field_map.longitude[-1])
    turned = np.unwrap(longitude)
    return turned + 2.0 * np.pi * np.round((middle - turned.mean()) / (2.0 * np.pi))


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
    north, east = metres_per_radian(float(found.latitude.mean()))
    shape = float(np.ptp(found.latitude) * north / (np.ptp(found.longitude) * east))
    figure = style.new_figure(min(max(2.0 * style.WIDTH * 0.42 * shape + 0.9, 3.0), 8.0))
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    names = ("error_mean", "error_worst", "ambiguity", "variability")
    titles = (
        "RMS error on arrival (m)",
        "on the worst heading (m)",
        "probability of a second place",
        "variability",
    )
    layers = found.layers()
    extent = [*np.degrees(found.longitude[[0, -1]]), *np.degrees(found.latitude[[0, -1]])]
    low = float(np.nanquantile(found.mean, 0.01))
    high = float(np.nanquantile(found.worst, 0.99))
    for panel, name, title in zip(panels.flat, names, titles, strict=True):
        grid, unit, _ = layers[name]
        if unit == "m/s²":
            grid, unit = grid / style.MGAL, "$10^{-5}$ m/s²"
        limits: dict[str, float] = (
            {"vmin": low, "vmax": high} if name.startswith("error") else {"vmin": 0.0}
        )
        if name == "ambiguity":
            limits["vmax"] = max(float(np.nanmax(grid)), 0.01)
        image = panel.imshow(
            grid,
            origin="lower",
            extent=extent,
            aspect=1.0 / np.cos(float(found.latitude.mean())),
            cmap="viridis",
            interpolation="nearest",
            **limits,
        )
        text = f"{title} ({unit})" if name == "variability" else title
        panel.set_title(text)
        panel.grid(False)
        # as tall as the map, whose shape is its own
        figure.colorbar(image, cax=panel.inset_axes((1.03, 0.0, 0.04, 1.0)))
    for panel in panels[1]:
        panel.set_xlabel("longitude (deg)")
    for panel in panels[:, 0]:
        panel.set_ylabel("latitude (deg)")
    return figure
