"""The figures of docs/evidence/real-data.md, from the results of real_data.py."""

import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.figures import style
from isogal.maps.field_map import FieldMap
from measured_data.clear_lake import Lake
from measured_data.lines import Line, clear_lake, scotland
from measured_data.map_figures import clear_lake_figure, learnt_error, scotland_figure
from measured_data.matches import Summary, residuals
from measured_data.scotland import Part

Results = dict[str, Lake | dict[str, Part] | dict[str, Summary]]
"""Of all studies: `clear_lake`, `scotland`, `untold`."""
CORRELATED = style.AIDED
WHITE = style.UNAIDED
DOT = {"markersize": 4.0, "markeredgecolor": "black", "markeredgewidth": 0.4}
MARKS = {"correlated": ("o", style.BLUE), "white": ("^", style.VERMILION)}


def write_figures(data: Path, results: Results, folder: Path) -> None:
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
        # a palette of 256 colours looks the same and takes a third of the space
        picture.quantize(256).save(folder / f"{name}.png", optimize=True)


@style.journal
def correlation_figure(data: Path, results: Results) -> Figure:
    """Correlation of the map's errors at two readings of a line by their distance: measured, and
    as assumed."""
    figure = style.new_figure(2.7)
    panels = figure.subplots(1, 2, sharey=True)
    lake, lines, _ = clear_lake(data)
    magnetic, flights, _ = scotland(data)
    lake_fit = results["clear_lake"]["settings"]["all lines"]
    learnt = learnt_error(results["scotland"]["tie lines"])
    own = learnt.apply(magnetic)
    for panel, field_map, group, length, title in (
        (panels[0], lake, lines, lake_fit["correlation_length"], "Clear Lake, four lines"),
        (panels[1], own, flights, learnt.correlation_length, "Scotland, flight lines"),
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
    """Return mean distance (m) and correlation of normalised residuals of the same line, for the
    pairs in each interval of distances."""
    total, weight, far = np.zeros((3, edges.size - 1))
    scale = []
    for line in lines:
        value, keep = residuals(line, field_map)
        latitude, longitude = line.latitude[keep], line.longitude[keep]
        z = value[keep] / field_map.sigma_at(latitude, longitude)
        scale.append(z**2)
        north_east = horizontal_difference(
            latitude[:, None], longitude[:, None], latitude, longitude
        )
        apart = np.hypot(north_east[..., 0], north_east[..., 1])
        i, j = np.triu_indices(z.size, 1)
        which = np.digitize(apart[i, j], edges) - 1
        for k in range(edges.size - 1):
            member = which == k
            total[k] += (z[i] * z[j])[member].sum()
            far[k] += apart[i, j][member].sum()
            weight[k] += member.sum()
    return far / weight, total / weight / np.concatenate(scale).mean()


@style.journal
def growth_figure(result: Lake) -> Figure:
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
            label = f"error, {kind} map error"
            panel.plot(count, error, marker, color=line.colour, label=label, **DOT)
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
def honesty_figure(results: Results) -> Figure:
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
            sigma = [math.hypot(row["sigma_long_m"], row["sigma_short_m"]) for row in fixes]
            error = [row["error_m"] for row in fixes]
            marker, colour = MARKS[kind]
            panel.plot(sigma, error, marker, color=colour, label=f"{kind} map error", **DOT)
        x = np.array([50.0, 2000.0])
        for factor, dashes in ((1, "-"), (2.5, (0, (4, 2)))):
            label = rf"error = ${factor}\sigma$"
            panel.plot(x, factor * x, color="black", linewidth=0.9, linestyle=dashes, label=label)
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
