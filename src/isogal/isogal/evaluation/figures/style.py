"""What all figures share: palette, line styles, sizes, axes of time and of map values."""

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from isogal.maps.tiled_map import ScalarMap

P = ParamSpec("P")
T = TypeVar("T")
Time = TypeVar("Time", float, Array)

WIDTH = 7.1
"""in, a full page's width; figures are this wide."""
DPI = 150
MGAL = 1e-5
"""m/s²."""

# Of the eight of Okabe and Ito, "Color universal design", 2008, which can be told apart with any
# colour vision.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"

FIELD_COLOURS = "cividis"
"""Colour map of fields: even in lightness, the same to all colour vision, rising grey in print."""


Dashes = str | tuple[float, tuple[float, ...]]
"""As matplotlib takes them."""
Options = dict[str, Any]
"""Keyword arguments of matplotlib's drawing functions."""


@dataclass(frozen=True, slots=True)
class Line:
    """Colour, dashes and width, so that two lines differ in more than colour."""

    colour: str
    dashes: Dashes
    width: float = 1.3

    def options(self) -> Options:
        """Keyword arguments of Axes.plot."""
        return {"color": self.colour, "linestyle": self.dashes, "linewidth": self.width}


AIDED = Line(BLUE, "-", 1.5)
UNAIDED = Line(VERMILION, (0, (5, 2)))
BOUND = Line(BLACK, (0, (1, 1.2)))
SMOOTHED = Line(GREEN, "-", 1.5)
SMOOTHED_BOUND = Line(GREEN, (0, (1, 1.2)))
TRUTH = Line(BLACK, "-", 1.0)
SERIES = (AIDED, UNAIDED, Line(GREEN, (0, (5, 1.5, 1, 1.5))))
"""Lines for curves side by side, in order."""
FIX_DOT: Options = {
    "color": SKY,
    "markeredgecolor": "black",
    "markeredgewidth": 0.5,
    "markersize": 3.5,
}
"""Of a fix on a map."""
BAND: Options = {"color": SKY, "alpha": 0.35, "linewidth": 0}
"""Of an area behind lines."""
_JOURNAL = {
    # comes with matplotlib, so a figure looks the same on every machine
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "0.88",
    "grid.linewidth": 0.5,
    "lines.solid_capstyle": "round",
    "legend.fontsize": 8,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "legend.handlelength": 2.6,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "contour.negative_linestyle": "solid",
}
"""Where it departs from matplotlib's own defaults."""


def journal(draw: Callable[P, T]) -> Callable[P, T]:
    """Run a drawing function with the journal's settings; the caller's matplotlib settings are
    untouched."""

    @wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> T:
        from matplotlib.style import context

        with context(_JOURNAL, after_reset=True):
            return draw(*args, **kwargs)

    return styled


def new_figure(height: float, width: float = WIDTH) -> "Figure":
    """Return an empty figure (in) with constrained layout, attached to no window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)  # text can be measured before the figure is saved
    return figure


@journal
def png(figure: "Figure") -> bytes:
    """Render a figure; equal figures give equal bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def hours(seconds: Time) -> Time:
    """Seconds as hours."""
    return seconds / 3600.0


def time_axis(axes: "Axes", end: float) -> None:
    """Label a time axis of data in hours, which ends at `end` hours; records under 20 minutes get
    a scale in minutes, under three minutes in seconds."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator

    axes.set_xlim(0.0, end)
    if end < 1.0 / 3.0:
        unit, in_an_hour = ("min", 60.0) if end >= 0.05 else ("s", 3600.0)
        step = next(one for one in (1, 2, 5, 10, 20) if end * in_an_hour <= 10 * one)
        axes.xaxis.set_major_locator(MultipleLocator(step / in_an_hour))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x * in_an_hour:g}"))
    else:
        axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]))
        unit = "h"
    axes.set_xlabel(f"time since start ({unit})")


@dataclass(frozen=True, slots=True)
class FieldScale:
    """How numbers of a map are written on an axis: (value - offset) / unit, with a label."""

    offset: float
    unit: float
    name: str
    """Of what is written, with the offset."""
    unit_name: str

    @property
    def unit_label(self) -> str:
        """The unit alone, in brackets."""
        return f"({self.unit_name})"

    @property
    def two_lines(self) -> str:
        """Name and unit, the latter on a second line."""
        return f"{self.name}\n{self.unit_label}"

    def __call__(self, values: ArrayLike) -> Array:
        """Scale values of the map."""
        return (np.asarray(values, dtype=np.float64) - self.offset) / self.unit


_MEDIAN_OF = 500
"""Rows and columns, at most, that the median of a map's values is taken from."""
_NAMES = {"gravity": "gravity", "disturbance": "gravity disturbance"}


def field_scale(field_map: "ScalarMap") -> FieldScale:
    """Scale of a map's values: gravity in 1e-5 m/s² above a round number near its middle,
    gradients in Eötvös, others as they are."""
    name = _NAMES.get(field_map.quantity, field_map.quantity.replace("_", " ")).capitalize()
    if field_map.unit == "1/s²":
        return FieldScale(0.0, 1e-9, name, "E")
    if field_map.unit != "m/s²":
        return FieldScale(0.0, 1.0, name, field_map.unit)
    middle = float(np.nanmedian(field_map.overview(_MEDIAN_OF).values))
    if abs(middle) < 0.1:
        return FieldScale(0.0, MGAL, name, "$10^{-5}$ m/s²")
    offset = round(middle, 2)
    return FieldScale(offset, MGAL, f"{name} − {offset:.2f} m/s²", "$10^{-5}$ m/s²")


def ellipse(covariance: Array, sigmas: float) -> Array:
    """Return (121, 2) points of the ellipse of a covariance (2, 2), about 0."""
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * math.pi, 121)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(sigmas * (circle * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def logarithmic(axis: "Axes") -> None:
    """Give a panel a logarithmic value axis with plain numbers and a fine grid.

    Where powers of ten are too few to read it by, numbers between them are written as well."""
    from matplotlib.ticker import FuncFormatter

    def between(value: float, _: object) -> str:
        low, high = axis.get_ylim()
        leading = round(value / 10.0 ** math.floor(math.log10(value) + 1e-9))
        written = range(2, 10) if high < 5.0 * low else (2, 5) if high < 50.0 * low else ()
        return f"{value:g}" if leading in written else ""

    axis.set_yscale("log")
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.yaxis.set_minor_formatter(FuncFormatter(between))
    axis.tick_params(axis="y", which="minor", labelsize=7.0)
    axis.grid(True, which="minor", axis="y", linewidth=0.25)


def legend_below(
    figure: "Figure | SubFigure", columns: int = 4, panels: "Sequence[Axes] | None" = None
) -> None:
    """Put one legend for all panels under a figure or subfigure, where it hides nothing.

    A label that panels share is listed once; there are as many columns as fit, up to
    `columns`."""
    entries: dict[str, Artist] = {}
    for panel in panels or figure.axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    for count in range(min(columns, len(entries)), 0, -1):
        legend = figure.legend(
            list(entries.values()), list(entries), loc="outside lower center", ncols=count
        )
        if count == 1 or legend.get_window_extent().width < 0.98 * figure.bbox.width:
            break
        legend.remove()


def nice_limit(value: float) -> float:
    """Round a positive number up to 1, 1.5, 2, 3, 4, 5, 6 or 8 times a power of ten."""
    if not (math.isfinite(value) and value > 0.0):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(
        m * power for m in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if m * power >= value * (1 - 1e-12)
    )
