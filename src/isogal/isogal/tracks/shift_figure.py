"""Figure: how likely each shift of a track is, by its readings and the prior."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.figures import style
from isogal.tracks.matching import Match
from isogal.tracks.places import Shifts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

MOST_PANELS = 6
_COLUMNS = 3
_DEPTH = 20.0
"""Natural logarithms below the best that are shown."""
_INSET = 0.38
"""Side of what is enlarged, in that of the panel."""


def has_shifts(matches: Sequence[Match]) -> bool:
    """Whether there is anything to draw."""
    return any(match.shifts is not None for match in matches)


@style.journal
def shift_figure(matches: Sequence[Match]) -> "Figure":
    """Draw the log posterior over all shifts of up to six batches, and the 2-sigma ellipse of the
    posterior with its widened covariance."""
    shown = [(match, s) for match in matches if (s := match.shifts) is not None][:MOST_PANELS]
    columns = min(_COLUMNS, len(shown))
    rows = math.ceil(len(shown) / columns)
    width = style.WIDTH if columns > 1 else 4.6
    figure = style.new_figure(0.6 + rows * width / columns * 0.88, width)
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    images = [_draw(panel, *one) for panel, one in zip(panels, shown, strict=False)]
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    figure.colorbar(
        images[0], ax=list(panels), label="log posterior below its maximum", pad=0.02, shrink=0.7
    )
    return figure


def _draw(panel: "Axes", match: Match, shifts: Shifts) -> "AxesImage":
    wide = shifts.overview or shifts
    log = wide.log_density
    image = _cells(panel, wide.centres, log - log.max(), wide.size)
    west, east = image.get_extent()[:2]
    mean, covariance = shifts.moments
    if match.fix.published:
        covariance = match.covariance[:2, :2]
    panel.plot(*_ellipse(mean, covariance), color="white", linewidth=2.4)
    panel.plot(*_ellipse(mean, covariance), color="black", linewidth=1.0)
    panel.plot(0.0, 0.0, "+", color="white", markersize=6.0)
    state = "fix" if match.fix.published else "no fix"
    panel.set_title(f"to {match.fix.time:.10g} s: {state}", fontsize="small")
    panel.set_xlabel("error of the track east (km)")
    panel.set_ylabel("north (km)")
    panel.grid(False)
    if 4.0 * math.sqrt(float(covariance.max())) < 0.08e3 * (east - west):
        _inset(panel, shifts, mean, covariance)
    return image


def _cells(panel: "Axes", cells: Array, depth: Array, size: float | None = None) -> "AxesImage":
    """Draw (K,) values of (K, 2) cells of a regular grid, m north and east; their size (m) is the
    least distance between two unless told."""
    if size is None:
        apart = np.diff(np.unique(np.round(cells[:, 1], 3)))
        size = float(apart.min()) if apart.size else 1.0
    index = np.rint((cells - cells.min(axis=0)) / size).astype(int)
    picture = np.full(index.max(axis=0) + 1, np.nan)
    picture[tuple(index.T)] = np.maximum(depth, -_DEPTH)
    (south, west), (north, east) = cells.min(axis=0) - 0.5 * size, cells.max(axis=0) + 0.5 * size
    return panel.imshow(
        picture,
        origin="lower",
        extent=(west / 1e3, east / 1e3, south / 1e3, north / 1e3),
        cmap="viridis",
        vmin=-_DEPTH,
        vmax=0.0,
        aspect="equal",
    )


def _inset(panel: "Axes", shifts: Shifts, mean: Array, covariance: Array) -> None:
    """Draw what is too small to be seen."""
    half = 3.5 * math.sqrt(float(np.diag(covariance).max())) / 1e3
    corner = (0.04, 0.58) if mean[1] > 0.0 else (0.58, 0.58)
    inset = panel.inset_axes((*corner, _INSET, _INSET))
    log = shifts.log_density
    near = np.abs(shifts.centres - mean).max(axis=1) < 1.2e3 * half
    _cells(inset, shifts.centres[near], (log - log.max())[near])
    inset.plot(*_ellipse(mean, covariance), color="black", linewidth=1.0)
    inset.set_xlim(mean[1] / 1e3 - half, mean[1] / 1e3 + half)
    inset.set_ylim(mean[0] / 1e3 - half, mean[0] / 1e3 + half)
    style.bare(inset, f"{2e3 * half:.0f} m wide", fontsize=6, bbox=style.LABEL_BOX)
    panel.indicate_inset_zoom(inset, edgecolor="white")


def _ellipse(mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Return east and north (km) of the 2-sigma ellipse."""
    edge = mean + style.ellipse(covariance, 2.0)
    return edge[:, 1] / 1e3, edge[:, 0] / 1e3
