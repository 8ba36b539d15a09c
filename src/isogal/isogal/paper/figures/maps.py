"""The map lookup in one and in two dimensions, and the maps with the track (paper figs. 54a, 54,
51, 57)."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style
from isogal.maps.field_map import FieldMap
from isogal.paper.cases import Plan, Setting
from isogal.paper.lookups import PROFILE_WINDOW, ProfileExample, WindowExample
from isogal.paper.published import FIGURE_54_SIDE, LOW
from isogal.sensors.trajectory import build_trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_EDGE: dict[str, Any] = {"markeredgecolor": "black", "markeredgewidth": 0.6}


@style.journal
def lookup_1d_figure(example: ProfileExample, field_map: FieldMap) -> "Figure":
    """Profile of the gravity map across the track with a reading and the places in the window that
    it may come from (fig-54a)."""
    offset, profile, centre = example.offset, example.profile, example.centre
    reading, candidates = example.reading, example.candidates
    sigma = LOW["gravity"]
    scale = style.field_scale(field_map)
    figure = style.new_figure(3.4)
    panel = figure.subplots()
    km = offset / 1e3
    panel.axvspan(
        (centre - PROFILE_WINDOW) / 1e3,
        (centre + PROFILE_WINDOW) / 1e3,
        color="0.92",
        linewidth=0,
        zorder=0,
        label="search window",
    )
    band = scale(np.array([reading - sigma, reading + sigma]))
    panel.axhspan(
        band[0], band[1], color=style.SKY, alpha=0.5, linewidth=0, label=r"reading $s \pm \sigma$"
    )
    panel.plot(km, scale(profile), **style.TRUTH.options(), label="map")
    panel.axvline(centre / 1e3, **style.UNAIDED.options(), label=r"prior $x^s$")
    panel.plot(
        0.0,
        scale(np.interp(0.0, offset, profile)),
        "*",
        color=style.GREEN,
        markersize=11,
        **_EDGE,
        label="truth",
    )
    panel.plot(
        candidates / 1e3,
        scale(np.interp(candidates, offset, profile)),
        "o",
        color=style.ORANGE,
        markersize=6,
        **_EDGE,
        label="candidates",
    )
    for number, place in enumerate(candidates, start=1):
        panel.annotate(
            f"$x_{number}$",
            (place / 1e3, float(scale(reading))),
            xytext=(0, 8),
            textcoords="offset points",
            ha="center",
        )
    panel.set_xlim(float(km[0]), float(km[-1]))
    panel.set_xlabel("east of the true place (km)")
    panel.set_ylabel(scale.label.replace(" (", "\n(", 1))
    figure.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return figure


@style.journal
def search_window_figure(example: WindowExample, field_map: FieldMap) -> "Figure":
    """Search window of 5 x 5 km with 50 candidates, the true place and the PDA solution
    (fig-54)."""
    figure = style.new_figure(4.4)
    panel = figure.subplots()
    _surroundings(panel, example, field_map)
    half = 0.5 * FIGURE_54_SIDE / 1e3
    panel.plot(
        [-half, half, half, -half, -half],
        [-half, -half, half, half, -half],
        color="white",
        linestyle="--",
        linewidth=1.4,
    )
    panel.scatter(
        example.candidates[:, 1] / 1e3,
        example.candidates[:, 0] / 1e3,
        s=14.0 + 60.0 * example.weight / example.weight.max(),
        color=style.ORANGE,
        edgecolors="black",
        linewidths=0.5,
        label=f"{len(example.weight)} candidates (size: weight)",
    )
    for place, marker, colour, size, label in (
        (np.zeros(2), "P", "white", 8, "prior (centre)"),
        (example.truth, "*", style.GREEN, 13, "truth"),
        (example.combined, "D", "black", 6, "PDA solution"),
    ):
        panel.plot(
            place[1] / 1e3,
            place[0] / 1e3,
            marker,
            color=colour,
            markersize=size,
            linestyle="",
            **_EDGE,
            label=label,
        )
    panel.grid(False)
    panel.set_xlabel("east (km)")
    panel.set_ylabel("north (km)")
    figure.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _surroundings(panel: "Axes", example: WindowExample, field_map: FieldMap) -> None:
    """Draw the map about the window, and the contour of the reading."""
    scale = style.field_scale(field_map)
    metres = metres_per_radian(example.latitude)
    side = np.linspace(-0.6, 0.6, 181) * FIGURE_54_SIDE
    north, east = np.meshgrid(side, side, indexing="ij")
    values = scale(
        field_map.value(example.latitude + north / metres[0], example.longitude + east / metres[1])
    )
    km = side / 1e3
    image = panel.imshow(
        values,
        extent=(km[0], km[-1], km[0], km[-1]),
        origin="lower",
        cmap=style.FIELD_COLOURS,
        interpolation="bilinear",
    )
    panel.figure.colorbar(image, ax=panel, label=scale.label, shrink=0.9)
    panel.contour(
        km, km, values, levels=[float(scale(example.reading))], colors="white", linewidths=1.2
    )


@style.journal
def map_figure(plan: Plan, quantity: str) -> "Figure":
    """The map with the vehicle's track, marked every half hour (figs. 51, 57)."""
    setting = Setting(quantity=quantity)
    field_map, trajectory = plan.field_map(setting), build_trajectory(plan.scenario(setting))
    scale = style.field_scale(field_map)
    figure = style.new_figure(4.0)
    panel = figure.subplots()
    rows, columns = (max(1, size // 900) for size in field_map.values.shape)
    values = scale(field_map.values[::rows, ::columns])
    extent = field_map.extent
    south, north, west, east = (
        math.degrees(x) for x in (extent.south, extent.north, extent.west, extent.east)
    )
    low, high = np.nanpercentile(values, [1.0, 99.0])
    image = panel.imshow(
        values,
        extent=(west, east, south, north),
        origin="lower",
        cmap=style.FIELD_COLOURS,
        vmin=low,
        vmax=high,
        interpolation="bilinear",
        aspect=1.0 / math.cos(float(np.mean(trajectory.latitude))),
    )
    figure.colorbar(image, ax=panel, label=scale.label, shrink=0.9, pad=0.02, extend="both")
    latitude = np.degrees(trajectory.latitude)
    longitude = np.degrees(np.unwrap(trajectory.longitude))
    panel.plot(longitude, latitude, color="white", linewidth=3.4)
    panel.plot(longitude, latitude, color="black", linewidth=1.5, label="track")
    half_hours = np.arange(0.0, trajectory.time[-1] + 1.0, 1800.0)
    panel.plot(
        np.interp(half_hours, trajectory.time, longitude),
        np.interp(half_hours, trajectory.time, latitude),
        "o",
        color=style.ORANGE,
        markersize=4.5,
        **_EDGE,
        label="every 30 min",
    )
    panel.plot(longitude[0], latitude[0], "^", color="white", markersize=8, **_EDGE, label="start")
    panel.grid(False)
    panel.set_xlabel("longitude (deg)")
    panel.set_ylabel("latitude (deg)")
    figure.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
