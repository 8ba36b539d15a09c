"""Error against protection level: the diagram of Stanford (docs/integrity.md)."""

from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.figures import style
from isogal.evaluation.integrity import level_of, rate_of
from isogal.evaluation.records import Runs
from isogal.scenario import Integrity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BINS = 80
"""Along either axis."""
SMALLEST = 1e-3
"""Error in units of the largest value at which the axes begin: smaller ones stand there."""


@style.journal
def stanford_figure(runs: Runs, settings: Integrity) -> "Figure":
    """Draw how many states have which error and which protection level, with the diagonal and the
    numbers of the regions that it, and the alert limit if there is one, make."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import FuncFormatter, NullFormatter

    level = level_of(runs, settings)
    error = np.where(np.isfinite(runs.horizontal_error), runs.horizontal_error, np.inf)
    figure = style.new_figure(5.4)
    panel = figure.subplots()
    top = _largest(error, level, settings.alert_limit)
    edges = np.geomspace(SMALLEST * top, top, BINS + 1)
    across, up = (np.clip(values, edges[0], edges[-1]).ravel() for values in (error, level))
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
    panel.set_xscale("log")
    panel.set_yscale("log")
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    panel.set_xlim(edges[0], edges[-1])
    panel.set_ylim(edges[0], edges[-1])
    panel.set_aspect("equal")
    panel.set_xlabel("horizontal error (m)")
    panel.set_ylabel(f"horizontal protection level at {settings.risk:g} per hour (m)")
    _regions(panel, runs, settings, level)
    return figure


def _regions(panel: "Axes", runs: Runs, settings: Integrity, level: Array) -> None:
    """Name the regions where they are, and say above how many states are in them."""
    error, limit = runs.horizontal_error, settings.alert_limit
    misleading = ~(error <= level)
    places = {"misleading": ((0.97, 0.03), misleading)}
    if limit is not None:
        available = level <= limit
        places["hazardous"] = ((0.97, 0.12), available & ~(error <= limit))
        places["not available"] = ((0.03, 0.97), ~available)
        for line in (panel.axvline, panel.axhline):
            line(limit, **style.BOUND.options())
    lines = []
    for name, ((x, y), which) in places.items():
        rate = rate_of(which, runs, settings)
        events = f"{rate.events} events in {rate.hours:.1f} h"
        states = f"{int(which.sum())} of {which.size} states"
        lines.append(f"{name}: {states}" + (f", {events}" if y < 0.5 else ""))
        panel.text(
            x,
            y,
            name,
            transform=panel.transAxes,
            horizontalalignment="right" if x > 0.5 else "left",
            verticalalignment="top" if y > 0.5 else "bottom",
            bbox=style.LABEL_BOX,
        )
    panel.set_title("\n".join(lines), loc="left")


def _largest(error: Array, level: Array, limit: float | None) -> float:
    """Return where the axes end, m."""
    values = np.concatenate([error.ravel(), level.ravel(), [1.0, 1.5 * (limit or 0.0)]])
    return style.nice_limit(1.1 * float(values[np.isfinite(values)].max()))
