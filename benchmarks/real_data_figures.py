"""The figures of docs/real-data.md, from the results of real_data.py."""

import io
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from PIL import Image
from real_data import MGAL, Line, bearings, clear_lake, match_line, residuals, scotland

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.figures import style
from isogal.maps.field_map import FieldMap
from isogal.tracks.figures import MATCHED, RECORDED, matched_positions
from isogal.tracks.map_error import MapError

CORRELATED = style.AIDED
WHITE = style.UNAIDED
_MARKS = {"correlated": ("o", style.BLUE), "white": ("^", style.VERMILION)}


def write_figures(data: Path, results: dict[str, Any], folder: Path) -> None:
    """Write all figures as PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {
        "real_data_clear_lake": clear_lake_figure(data, results["clear_lake"]),
        "real_data_correlation": correlation_figure(data, results),
        "real_data_growth": growth_figure(results["clear_lake"]),
        "real_data_honesty": honesty_figure(results),
        "real_data_scotland": scotland_figure(data, results["scotland"]["tie lines"]),
    }
    for name, figure in figures.items():
        picture = Image.open(io.BytesIO(style.png(figure))).convert("RGB")
        # 256 colours: a third of the size, and nobody sees it
        picture.quantize(256).save(folder / f"{name}.png", optimize=True)


def _image(
    panel: Axes, field_map: FieldMap, values: Array, label: str, percent: float = 1.0
) -> None:
    west, east = (math.degrees(field_map.longitude[i]) for i in (0, -1))
    south, north = (math.degrees(field_map.latitude[i]) for i in (0, -1))
    low, high = np.nanpercentile(values, [percent, 100.0 - percent])
    image = panel.imshow(
        values,
        extent=(west, east, south, north),
        origin="lower",
        cmap=style.FIELD_COLOURS,
        vmin=low,
        vmax=high,
        aspect=1.0 / math.cos(float(field_map.latitude.mean())),
    )
    panel.figure.colorbar(
        image, ax=panel, label=label, shrink=0.8, pad=0.03, aspect=28, extend="both"
    )
    panel.grid(False)
    panel.set_facecolor("0.9")
    panel.set_xlabel("longitude (deg)")
    panel.set_ylabel("latitude (deg)")
    panel.xaxis.set_major_locator(MultipleLocator(0.2 if east - west < 1.0 else 0.5))
    panel.yaxis.set_major_locator(MultipleLocator(0.2))


def _path(panel: Axes, latitude: Array, longitude: Array, line: style.Line, label: str) -> None:
    panel.plot(
        np.degrees(longitude), np.degrees(latitude), color="white", linewidth=line.width + 1.6
    )
    panel.plot(np.degrees(longitude), np.degrees(latitude), **line.options(), label=label)


@style.journal
def clear_lake_figure(data: Path, result: dict[str, Any]) -> Figure:
    """The four lines on the map, where a navigator 3 km off says they are and where the match puts
    them; beside it, the map's own error."""
    field_map, lines, _ = clear_lake(data)
    figure = style.new_figure(5.2)
    left, right = figure.subplots(1, 2, sharey=True)
    _image(left, field_map, field_map.values / MGAL, "Bouguer disturbance ($10^{-5}$ m/s²)")
    _image(
        right,
        field_map,
        np.asarray(field_map.sigma) / MGAL,
        r"the map's own $1\sigma$ ($10^{-5}$ m/s²)",
        0.0,
    )
    shift = bearings(8)[1]
    for number, line in enumerate(lines):
        fit = result["settings"][line.name]
        matches = match_line(
            line, field_map, fit["correlation_length"], fit["sensor_sigma"], shift
        )
        track = line.track(1.0, shift)
        names = (
            ["as the navigator says", "as matched", "stations, where they are"]
            if number == 0
            else ["_"] * 3
        )
        _path(left, track.latitude, track.longitude, RECORDED, names[0])
        _path(left, *matched_positions(track, matches), MATCHED, names[1])
        left.plot(
            np.degrees(line.longitude),
            np.degrees(line.latitude),
            "k.",
            markersize=1.8,
            label=names[2],
        )
        right.plot(
            np.degrees(line.longitude),
            np.degrees(line.latitude),
            ".",
            color="white",
            markersize=3.4,
        )
        right.plot(
            np.degrees(line.longitude),
            np.degrees(line.latitude),
            ".",
            color="black",
            markersize=2.0,
        )
        end = line.latitude.argmax() if number in (0, 3) else line.latitude.argmin()
        right.annotate(
            str(number),
            (math.degrees(line.longitude[end]), math.degrees(line.latitude[end])),
            xytext=(0, 7 if number in (0, 3) else -12),
            textcoords="offset points",
            ha="center",
            fontweight="bold",
            bbox={
                "boxstyle": "round,pad=0.15",
                "facecolor": "white",
                "edgecolor": "none",
                "alpha": 0.85,
            },
        )
    right.set_ylabel("")
    style.legend_below(figure)
    return figure


@style.journal
def correlation_figure(data: Path, results: dict[str, Any]) -> Figure:
    """How alike the map's errors are at two readings of a line, by their distance: measured, and
    as assumed."""
    figure = style.new_figure(2.7)
    panels = figure.subplots(1, 2, sharey=True)
    lake, lines, _ = clear_lake(data)
    magnetic, flights, _ = scotland(data)
    lake_fit = results["clear_lake"]["settings"]["all lines"]
    settings = {
        k: v for k, v in results["scotland"]["tie lines"]["settings"].items() if k != "even_sigma"
    }
    own = MapError(**settings).apply(magnetic)
    for panel, field_map, group, length, title in (
        (panels[0], lake, lines, lake_fit["correlation_length"], "Clear Lake, four lines"),
        (panels[1], own, flights, settings["correlation_length"], "Scotland, flight lines"),
    ):
        edges = np.array([0.0, 0.25, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 12.5, 15]) * 1e3
        middle, value = _correlation(group, field_map, edges)
        distance = np.linspace(0.0, 15.0, 200)
        panel.axhline(0.0, color="0.5", linewidth=0.6)
        panel.plot(
            distance,
            np.exp(-distance * 1e3 / length),
            **CORRELATED.options(),
            label=r"assumed, $e^{-d/L}$",
        )
        panel.plot([0.0, 1e-9, 15.0], [1.0, 0.0, 0.0], **WHITE.options(), label="white noise")
        panel.plot(middle / 1e3, value, "o", color="black", markersize=3.5, label="measured")
        panel.set_title(f"{title}, L = {length / 1e3:.1f} km", loc="left")
        panel.set_xlabel("distance between readings (km)")
        panel.set_xlim(0.0, 15.0)
        panel.set_ylim(-0.5, 1.15)
    panels[0].set_ylabel("correlation of the\nnormalised residuals")
    style.legend_below(figure)
    return figure


def _correlation(lines: Sequence[Line], field_map: FieldMap, edges: Array) -> tuple[Array, Array]:
    total, weight, far = (
        np.zeros(edges.size - 1),
        np.zeros(edges.size - 1),
        np.zeros(edges.size - 1),
    )
    scale = []
    for line in lines:
        value, keep = residuals(line, field_map)
        latitude, longitude = line.latitude[keep], line.longitude[keep]
        z = value[keep] / field_map.sigma_at(latitude, longitude)
        scale.append(z**2)
        apart = np.hypot(
            *np.moveaxis(
                horizontal_difference(latitude[:, None], longitude[:, None], latitude, longitude),
                -1,
                0,
            )
        )
        i, j = np.triu_indices(z.size, 1)
        which = np.digitize(apart[i, j], edges) - 1
        for k in range(edges.size - 1):
            member = which == k
            total[k] += (z[i] * z[j])[member].sum()
            far[k] += apart[i, j][member].sum()
            weight[k] += member.sum()
    return far / weight, total / weight / np.concatenate(scale).mean()


@style.journal
def growth_figure(result: dict[str, Any]) -> Figure:
    """Error and 1-sigma of the fix on each line as it gets longer, with correlated and with white
    map errors."""
    figure = style.new_figure(4.4)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for panel, (name, steps) in zip(panels.flat, result["growth"].items(), strict=True):
        count = [step["readings"] for step in steps]
        for kind, line, marker in (("correlated", CORRELATED, "o"), ("white", WHITE, "^")):
            error, sigma = (
                np.array([step[kind][key] for step in steps]) / 1e3
                for key in ("error_m", "sigma_long_m")
            )
            panel.plot(
                count, sigma, **line.options(), label=rf"$1\sigma$ claimed, {kind} map error"
            )
            panel.plot(
                *(count, error, marker), color=line.colour, markersize=4.0, markeredgecolor="black", markeredgewidth=0.4,
                label=f"error, {kind} map error",
            )  # fmt: skip
        style.logarithmic(panel)
        panel.set_title(name, loc="left")
    for panel in panels[1]:
        panel.set_xlabel("stations")
    for panel in panels[:, 0]:
        panel.set_ylabel("km")
    panels[0, 0].set_ylim(0.02, 5.0)
    style.legend_below(figure, columns=2)
    return figure


@style.journal
def honesty_figure(results: dict[str, Any]) -> Figure:
    """Error of each whole-line fix against its own 1-sigma."""
    figure = style.new_figure(3.4)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    ties = results["scotland"]["tie lines"]
    lake = results["clear_lake"]
    whole = {
        kind: [row for part in lake[name].values() for row in part["rows"]]
        for kind, name in (("correlated", "whole"), ("white", "white"))
    }
    groups = (
        ("Clear Lake", whole),
        (
            "Scotland, tie lines",
            {"correlated": ties["own"]["rows"], "white": ties["white"]["rows"]},
        ),
    )
    for panel, (title, kinds) in zip(panels, groups, strict=True):
        for kind, rows in kinds.items():
            fixes = [row for row in rows if "error_m" in row]
            sigma = np.array(
                [math.hypot(row["sigma_long_m"], row["sigma_short_m"]) for row in fixes]
            )
            error = np.array([row["error_m"] for row in fixes])
            marker, colour = _MARKS[kind]
            panel.plot(
                *(sigma, error, marker), color=colour, markersize=4.2, markeredgecolor="black", markeredgewidth=0.4,
                label=f"{kind} map error",
            )  # fmt: skip
        x = np.array([50.0, 2000.0])
        panel.plot(x, x, color="black", linewidth=0.9, label=r"error = $1\sigma$")
        panel.plot(
            x,
            2.5 * x,
            color="black",
            linewidth=0.9,
            linestyle=(0, (4, 2)),
            label=r"error = $2.5\sigma$",
        )
        panel.set_xscale("log")
        style.logarithmic(panel)
        panel.set_xlim(60.0, 1500.0)
        panel.set_ylim(10.0, 3000.0)
        panel.set_title(title, loc="left")
        panel.set_xlabel(r"$1\sigma$ claimed, both axes together (m)")
        panel.xaxis.set_major_formatter(panel.yaxis.get_major_formatter())
        panel.set_xticks([100.0, 300.0, 1000.0])
    panels[0].set_ylabel("error of the fix (m)")
    style.legend_below(figure)
    return figure


@style.journal
def scotland_figure(data: Path, part: dict[str, Any]) -> Figure:
    """The map with flight lines and tie lines; the map error that was learnt from the flight
    lines."""
    field_map, flights, ties = scotland(data)
    settings = {k: v for k, v in part["settings"].items() if k != "even_sigma"}
    own = MapError(**settings).apply(field_map)
    figure = style.new_figure(3.2)
    upper, lower = figure.subplots(1, 2, sharey=True)
    _image(upper, field_map, field_map.values, "magnetic anomaly (nT)")
    _image(lower, own, np.asarray(own.sigma), r"$1\sigma$ learnt from the flight lines (nT)", 2.0)
    for panel in (upper, lower):
        for group, line, label in (
            (flights, RECORDED, "flight lines (settings)"),
            (ties, MATCHED, "tie lines (matched)"),
        ):
            for number, one in enumerate(group):
                _path(
                    panel,
                    one.latitude,
                    one.longitude,
                    replace(line, width=1.0),
                    label if number == 0 else "_",
                )
        panel.set_xlim(*(math.degrees(field_map.longitude[i]) for i in (0, -1)))
        panel.set_ylim(*(math.degrees(field_map.latitude[i]) for i in (0, -1)))
    lower.set_ylabel("")
    rows: dict[str, list[float]] = {}
    for row in part["own"]["rows"]:
        rows.setdefault(row["line"], []).append(row.get("error_m", math.nan))
    for line in ties:
        error = (
            float(np.nanmedian(rows[line.name]))
            if np.isfinite(rows[line.name]).any()
            else math.nan
        )
        upper.annotate(
            f"{error:.0f} m" if math.isfinite(error) else "no fix",
            (math.degrees(line.longitude[-1]), math.degrees(line.latitude[-1])),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            va="bottom",
            rotation=90,
            fontsize=6.5,
            annotation_clip=False,
        )
    style.legend_below(figure)
    return figure
