"""The figures of the page, in Bokeh: the whole route on the map, the surroundings of the vehicle
at the time of the slider, and panels over time, which share one axis of time, one line for the
time of the slider and one under the pointer. The page's script fills the data sources, which it
finds by name.

What the page says beside a figure, its title and the key of its lines, is text of the page and no
part of the drawing, so that it folds on a narrow page."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

from isogal.evaluation.figures.style import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from isogal.evaluation.view.background import Background

if TYPE_CHECKING:
    from bokeh.plotting import figure as Figure  # noqa: N812  a class

_COLUMNS = {"alpha", "size", "colour", "marker"}
"""Values of a style that are columns of the data source."""
_TEXTS = ("fixes", "events")
"""Data sources with a text for each mark."""
ROWS = ["fixes", "messages"]
"""Rows of the panel of what was said: outcomes of batches, and diagnostics."""


class Panel(NamedTuple):
    """A figure over time, and what the page says beside it."""

    name: str
    height: int
    values: str
    """Label of the axis of values."""
    title: str
    caption: str = ""
    scale: Literal["linear", "log"] = "linear"


def _panels(quantity: str, unit: str) -> list[Panel]:
    """Return the panels, given quantity and unit of the readings."""
    signal, difference = "Readings against the map", "Reading minus map at the navigator's place"
    seek = "Click a time to go there; drag to zoom in time, in all panels at once."
    usual = "Grey: where 95 % of single values of a consistent navigator lie."
    first, said = "First channel where an instrument has several.", "Outcomes of batches"
    return [
        Panel("errors", 200, "error (m)", "Horizontal position error", seek, "log"),
        Panel("north", 150, "north (m)", "North error, and 3 sigma as claimed"),
        Panel("east", 150, "east (m)", "East error, and 3 sigma as claimed"),
        Panel("nees", 160, "NEES", "NEES per axis (1 on average)", usual, "log"),
        Panel("signal", 180, f"({unit})", f"{signal}: {quantity}", first),
        Panel("difference", 140, f"({unit})", difference),
        Panel("said", 150, "", f"{said}, and what the nodes said", "Point at a mark to read it."),
    ]


MAPS = {
    "overview": (
        "Map and tracks over the whole route",
        "Whole route on the map. Click a place to go there; the frame is what the map beside it"
        " shows.",
    ),
    "close_up": (
        "Surroundings: candidates, fixes and what is claimed",
        "At the time of the slider.",
    ),
}
"""Figures that are maps, with title and caption."""


class Layer(NamedTuple):
    """What is drawn of a data source."""

    figures: str
    """In which."""
    glyph: str
    """The method of a Bokeh figure that draws it."""
    source: str
    columns: str
    style: Mapping[str, str | float]
    label: str = ""
    """Of its entry in the key, which hides it when it is clicked; none without."""

    @property
    def name(self) -> str:
        """By which the page finds what is drawn in a figure."""
        return self.columns.split()[-1] if self.glyph == "line" else self.source

    @property
    def colour(self) -> str:
        """In the key."""
        return str(self.style.get("fill_color", self.style.get("line_color")))

    @property
    def kind(self) -> str:
        """In the key: line, dash, dots, disc or area."""
        dashes = {"solid": "line", "dashed": "dash", "dotted": "dots"}
        lines = dashes[str(self.style.get("line_dash", "solid"))]
        return {"scatter": "disc", "patches": "area"}.get(self.glyph, lines)


def _line(colour: str, width: float, dash: str = "solid") -> dict[str, str | float]:
    return {"line_color": colour, "line_width": width, "line_dash": dash}


def _mark(colour: str, size: float | str, **more: str | float) -> dict[str, str | float]:
    return {"size": size, "fill_color": colour, "line_color": "black", **more}


_BOTH = "overview close_up"
_UNAIDED, _AIDED = _line(VERMILION, 2, "dashed"), _line(BLUE, 1.6)
_PROTECTION, _EXPECTED = _line(PURPLE, 2, "dotted"), _line(ORANGE, 1.2, "dashed")
_AFTER = "posterior after the batch, 95 %"
_CANDIDATES = _mark("white", "size", fill_alpha=0.8, line_width=0.6)
_ELLIPSES = _line(SKY, 2) | {"line_alpha": "alpha"}
_POSTERIOR = _line(PURPLE, 2) | {"fill_color": PURPLE, "fill_alpha": 0.35}
_FIXES = _mark(SKY, 7, fill_alpha="alpha", line_alpha="alpha")
_FRAME = _line("black", 1.2) | {"fill_color": "white", "fill_alpha": 0.12}
_NOW = _mark("colour", 11, marker="marker", line_width=1.5) | {"line_color": "white"}
_BAND: dict[str, str | float] = {"fill_color": GREEN, "fill_alpha": 0.2}
_READINGS = _mark(BLUE, 3, line_width=0)
_EVENTS = _mark("colour", 9, marker="marker", line_width=0.5)
LAYERS = [
    Layer(_BOTH, "line", "tracks", "x y", _line("white", 4) | {"line_alpha": 0.8}),
    Layer(_BOTH, "line", "tracks", "unaided_x unaided_y", _UNAIDED, "unaided INS"),
    Layer(_BOTH, "line", "tracks", "x y", _line("black", 1.6), "true track"),
    Layer(_BOTH, "line", "tracks", "aided_x aided_y", _AIDED, "aided navigator"),
    Layer("close_up", "scatter", "candidates", "x y", _CANDIDATES, "candidates of the batch"),
    Layer("close_up", "multi_line", "fix_ellipses", "xs ys", _ELLIPSES, "fix alone, 95 %"),
    Layer("close_up", "patches", "posterior", "xs ys", _POSTERIOR, _AFTER),
    Layer("close_up", "multi_line", "claimed", "xs ys", _line(BLUE, 2.5), "navigator now, 95 %"),
    Layer("close_up", "multi_line", "protection", "xs ys", _PROTECTION, "protection level"),
    Layer(_BOTH, "scatter", "fixes", "x y", _FIXES, "fix"),
    Layer("overview", "quad", "frame", "left right top bottom", _FRAME),
    Layer(_BOTH, "scatter", "now", "x y", _NOW),
    Layer("errors", "line", "states", "t unaided", _UNAIDED | {"line_width": 1.6}, "unaided INS"),
    Layer("errors", "line", "states", "t error", _AIDED, "aided navigator"),
    Layer("errors", "line", "states", "t sigma", _line(GREEN, 1.6), "claimed, 1 sigma"),
    Layer("errors", "line", "states", "t level", _line(PURPLE, 1.6), "protection level"),
    Layer("north", "varea", "states", "t north_low north_high", _BAND),
    Layer("north", "line", "states", "t north", _line(BLUE, 1.4)),
    Layer("east", "varea", "states", "t east_low east_high", _BAND),
    Layer("east", "line", "states", "t east", _line(BLUE, 1.4)),
    Layer("nees", "line", "states", "t nees", _line(BLUE, 1), "all states"),
    Layer("nees", "scatter", "after_fixes", "t nees", _mark(SKY, 6), "after a fix"),
    Layer("signal", "line", "readings", "t truth", _line("black", 1.2), "map at the true place"),
    Layer("signal", "line", "readings", "t navigator", _EXPECTED, "map at the navigator's place"),
    Layer("signal", "scatter", "readings", "t reading", _READINGS, "reading, reduced"),
    Layer("difference", "line", "readings", "t difference", _line(BLUE, 1)),
    Layer("said", "scatter", "events", "t row", _EVENTS),
]
"""From below to above."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure with its texts."""

    plot: "Figure"
    title: str
    caption: str

    @property
    def name(self) -> str:
        """The figure's name."""
        return str(self.plot.name)

    @property
    def layers(self) -> list[Layer]:
        """What is drawn in it."""
        return [layer for layer in LAYERS if self.name in layer.figures.split()]


def drawings(
    back: Background, readings: tuple[str, str], end: float, interval: tuple[float, float]
) -> list[Drawing]:
    """Return the figures of the page, without numbers.

    Parameters
    ----------
    back : Background
        The map.
    readings : pair of str
        Their quantity and unit, and those of the map's colours.
    end : float
        h, of the axis of time.
    interval : pair of float
        That one state's NEES per axis stays in with 95 %.
    """
    from bokeh.models import ColumnDataSource, CustomJS, HoverTool

    columns: dict[str, set[str | float]] = {name: {"text"} for name in _TEXTS}
    for layer in LAYERS:
        own = {*layer.columns.split(), *_COLUMNS.intersection(layer.style.values())}
        columns.setdefault(layer.source, set()).update(own)
    sources = {
        name: ColumnDataSource({column: [] for column in sorted(map(str, each))}, name=name)
        for name, each in columns.items()
    }
    label = "{} ({})".format(*readings)
    found = [Drawing(_map(name, back, label), *texts) for name, texts in MAPS.items()]
    found += _over_time(_panels(*readings), end, interval)
    for drawing in found:
        plot = drawing.plot
        plot.toolbar.logo, plot.toolbar.autohide = None, True
        seek = "seekPlace(cb_obj.x, cb_obj.y)" if drawing.name in MAPS else "seek(cb_obj.x)"
        plot.js_on_event("tap", CustomJS(code=f"window.isogalView.{seek}"))
        for layer in drawing.layers:
            named = {"name": f"{drawing.name}.{layer.name}"} if layer.label else {}
            draw, source = getattr(plot, layer.glyph), sources[layer.source]
            drawn = draw(*layer.columns.split(), source=source, **layer.style, **named)
            if layer.source in _TEXTS:
                plot.add_tools(HoverTool(renderers=[drawn], tooltips="@text"))
    return found


def _map(name: str, back: Background, label: str) -> "Figure":
    """Return the map in a figure; in that of the whole route with a bar of its colours."""
    from bokeh.models import BasicTicker, ColorBar, LinearColorMapper, Range1d
    from bokeh.palettes import Cividis256
    from bokeh.plotting import figure

    whole = name == "overview"
    plot = figure(
        name=name, height=400, sizing_mode="stretch_width", match_aspect=True,
        x_range=Range1d(back.west, back.west + back.width) if whole else Range1d(-5, 5),
        y_range=Range1d(back.south, back.south + back.height) if whole else Range1d(-5, 5),
        tools="pan,wheel_zoom,box_zoom,reset,tap", active_scroll="wheel_zoom", active_drag="pan",
        x_axis_label="east (km)", y_axis_label="north (km)", background_fill_color="#f4f4f4",
    )  # fmt: skip
    plot.grid.visible = False
    plot.image_url(
        url=[back.picture], x=back.west, y=back.south, w=back.width, h=back.height,
        anchor="bottom_left", level="image", global_alpha=1.0 if whole else 0.55,
    )  # fmt: skip
    lines = back.coarse if whole or not back.fine.x.size else back.fine
    colour = "white" if whole else "black"
    plot.line(lines.x, lines.y, line_color=colour, line_alpha=0.35, line_width=0.8)
    if whole:
        bar = ColorBar(
            color_mapper=LinearColorMapper(Cividis256, low=back.low, high=back.high),
            ticker=BasicTicker(desired_num_ticks=5), title=label, height=10, padding=4,
            title_text_font_style="normal", title_text_font_size="11px", border_line_color=None,
        )  # fmt: skip
        plot.add_layout(bar, "below")
    return plot


def _over_time(panels: list[Panel], end: float, interval: tuple[float, float]) -> list[Drawing]:
    """Return the empty panels, which share axis of time (h), cursor and pointer."""
    from bokeh.models import BoxAnnotation, CrosshairTool, FactorRange, Range1d, Span
    from bokeh.plotting import figure

    margin = 0.01 * end
    time = Range1d(0.0, end, bounds=(-margin, end + margin), name="time_range")
    cursor = Span(location=0.0, dimension="height", line_width=1.5, name="cursor")
    pointer = Span(dimension="height", line_color="#888888", line_dash="dotted", line_width=1)
    plots = {
        panel.name: figure(
            name=panel.name, height=panel.height, x_range=time, min_border_left=72,
            # the script finds better ones
            y_range=Range1d(1.0, 10.0) if panel.values else FactorRange(*reversed(ROWS)),
            y_axis_type=panel.scale if panel.values else "auto", y_axis_label=panel.values,
            tools="xpan,xwheel_zoom,xbox_zoom,reset,tap", active_drag="xbox_zoom",
            sizing_mode="stretch_width",
        )
        for panel in panels
    }  # fmt: skip
    for plot in plots.values():
        plot.add_tools(CrosshairTool(overlay=pointer))
        plot.add_layout(cursor)
    low, high = interval
    plots["nees"].add_layout(
        BoxAnnotation(bottom=low, top=high, fill_color="#888888", fill_alpha=0.15)
    )
    plots["said"].ygrid.visible = False
    plots["said"].xaxis.axis_label = "time since start (h)"
    return [Drawing(plots[panel.name], panel.title, panel.caption) for panel in panels]
