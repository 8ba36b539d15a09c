"""The figures of the page, in Bokeh: the whole route on the map, the surroundings of the vehicle
at the time of the slider, and panels over time, which share one axis of time, one line for the
time of the slider and one under the pointer. The page's script fills the data sources, which it
finds by name.

What the page says beside a figure, its title and the key of its lines, is text of the page and no
part of the drawing, so that it folds on a narrow page."""

from dataclasses import dataclass, field
from typing import Any

from isogal.evaluation.figures import style
from isogal.evaluation.view.background import Background, Lines

SOURCES: dict[str, tuple[str, ...]] = {
    "tracks": ("x", "y", "aided_x", "aided_y", "unaided_x", "unaided_y"),
    "fixes": ("x", "y", "alpha", "text"),
    "fix_ellipses": ("xs", "ys", "alpha"),
    "candidates": ("x", "y", "size"),
    "posterior": ("xs", "ys"),
    "claimed": ("xs", "ys"),
    "protection": ("xs", "ys"),
    "now": ("x", "y", "colour", "marker"),
    "frame": ("left", "right", "bottom", "top"),
    "states": (
        "t", "error", "sigma", "unaided", "level", "north", "east", "north_low", "north_high",
        "east_low", "east_high", "nees",
    ),
    "after_fixes": ("t", "nees"),
    "readings": ("t", "reading", "truth", "navigator", "difference"),
    "events": ("t", "row", "colour", "marker", "text"),
}  # fmt: skip
"""Data sources and their columns."""
ROWS = ["fixes", "messages"]
"""Rows of the panel of what was said: outcomes of batches, and diagnostics."""
CAPTIONS = {
    "overview": "Whole route on the map. Click a place to go there; the frame is what the map"
    " beside it shows.",
    "close_up": "At the time of the slider.",
    "errors": "Click a time to go there; drag to zoom in time, in all panels at once.",
    "nees": "Grey: where 95 % of single values of a consistent navigator lie.",
    "signal": "First channel where an instrument has several.",
    "said": "Point at a mark to read it.",
}


@dataclass(frozen=True, slots=True)
class Key:
    """An entry of a key, which hides what it names when it is clicked."""

    name: str
    """Of what is drawn, alone in the page."""
    label: str
    colour: str
    kind: str = "line"
    """line, dash, dots, disc or area."""


@dataclass(slots=True)
class Drawing:
    """A figure with its texts."""

    plot: Any
    """Bokeh figure."""
    title: str
    keys: list[Key] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The figure's name."""
        return str(self.plot.name)

    @property
    def caption(self) -> str:
        """What is said below it."""
        return CAPTIONS.get(self.name, "")

    def line(self, y: str, label: str, colour: str, *, x: str = "t", **options: Any) -> Any:
        """Draw a line; with a label it gets an entry of the key."""
        dashes = options.get("line_dash", "solid")
        kind = {"solid": "line", "dashed": "dash", "dotted": "dots"}[dashes]
        name = self.key(y, label, colour, kind)
        return self.plot.line(x, y, line_color=colour, name=name, **options)

    def key(self, what: str, label: str, colour: str, kind: str) -> str:
        """Add an entry of the key; return the name that what is drawn must have."""
        name = f"{self.name}.{what}"
        self.keys.append(Key(name, label, colour, kind))
        return name


def _drawing(name: str, title: str, seek: str, **options: Any) -> Drawing:
    """Return an empty figure, in which a click calls `seek` of the page's script."""
    from bokeh.models import CustomJS
    from bokeh.plotting import figure

    plot = figure(name=name, sizing_mode="stretch_width", **options)
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    plot.js_on_event("tap", CustomJS(code=f"window.isogalView.{seek}"))
    return Drawing(plot, title)


def drawings(
    back: Background, label: str, end: float, interval: tuple[float, float]
) -> list[Drawing]:
    """Return the figures of the page, without numbers.

    Parameters
    ----------
    back : Background
        The map.
    label : str
        Quantity and unit of its colours, and of the readings.
    end : float
        h, of the axis of time.
    interval : pair of float
        That one state's NEES per axis stays in with 95 %.
    """
    from bokeh.models import ColumnDataSource, Range1d, Span

    data = {
        name: ColumnDataSource({column: [] for column in columns}, name=name)
        for name, columns in SOURCES.items()
    }
    margin = 0.01 * end
    shared = _Panels(
        data,
        Range1d(0.0, end, bounds=(-margin, end + margin), name="time_range"),
        Span(location=0.0, dimension="height", line_color="black", line_width=1.5, name="cursor"),
        Span(dimension="height", line_color="#888888", line_dash="dotted", line_width=1),
    )
    return [
        _overview(back, data, label),
        _close_up(back, data),
        _errors(shared),
        _component(shared, "north"),
        _component(shared, "east"),
        _nees(shared, interval),
        _signal(shared, label),
        _difference(shared, label),
        _said(shared),
    ]


def _overview(back: Background, data: dict[str, Any], label: str) -> Drawing:
    """Return the map of the whole route; `label` is the quantity and unit of the colours."""
    from bokeh.models import BasicTicker, ColorBar, LinearColorMapper
    from bokeh.palettes import Cividis256

    drawing = _map_figure("overview", "Map and tracks over the whole route")
    plot = drawing.plot
    _background(plot, back, back.coarse, "white", 1.0)
    _tracks(drawing, data)
    _fixes(drawing, data)
    plot.quad(
        source=data["frame"], fill_alpha=0.12, fill_color="white", line_color="black",
        line_width=1.2,
    )  # fmt: skip
    _now(plot, data)
    plot.x_range.start, plot.x_range.end = back.west, back.west + back.width
    plot.y_range.start, plot.y_range.end = back.south, back.south + back.height
    bar = ColorBar(
        color_mapper=LinearColorMapper(Cividis256, low=back.low, high=back.high),
        ticker=BasicTicker(desired_num_ticks=5), title=label, title_text_font_style="normal",
        title_text_font_size="11px", height=10, padding=4, border_line_color=None,
    )  # fmt: skip
    plot.add_layout(bar, "below")
    return drawing


def _close_up(back: Background, data: dict[str, Any]) -> Drawing:
    """Return the map of the vehicle's surroundings."""
    drawing = _map_figure("close_up", "Surroundings: candidates, fixes and what is claimed")
    plot, key = drawing.plot, drawing.key
    lines = back.fine if back.fine.x.size else back.coarse
    _background(plot, back, lines, "black", 0.55)
    _tracks(drawing, data)
    plot.scatter(
        "x", "y", size="size", source=data["candidates"], fill_color="white", fill_alpha=0.8,
        line_color="black", line_width=0.6,
        name=key("candidates", "candidates of the batch", "white", "disc"),
    )  # fmt: skip
    plot.multi_line(
        "xs", "ys", source=data["fix_ellipses"], line_color=style.SKY, line_width=2,
        line_alpha="alpha", name=key("fix_ellipses", "fix alone, 95 %", style.SKY, "line"),
    )  # fmt: skip
    plot.patches(
        "xs", "ys", source=data["posterior"], fill_color=style.PURPLE, fill_alpha=0.35,
        line_color=style.PURPLE, line_width=2,
        name=key("posterior", "posterior after the batch, 95 %", style.PURPLE, "area"),
    )  # fmt: skip
    plot.multi_line(
        "xs", "ys", source=data["claimed"], line_color=style.BLUE, line_width=2.5,
        name=key("claimed", "navigator now, 95 %", style.BLUE, "line"),
    )  # fmt: skip
    plot.multi_line(
        "xs", "ys", source=data["protection"], line_color=style.PURPLE, line_width=2,
        line_dash="dotted", name=key("protection", "protection level", style.PURPLE, "dots"),
    )  # fmt: skip
    _fixes(drawing, data)
    _now(plot, data)
    return drawing


def _map_figure(name: str, title: str) -> Drawing:
    from bokeh.models import Range1d

    drawing = _drawing(
        name, title, "seekPlace(cb_obj.x, cb_obj.y)", height=400,
        x_range=Range1d(-5, 5), y_range=Range1d(-5, 5), match_aspect=True,
        tools="pan,wheel_zoom,box_zoom,reset,tap", active_scroll="wheel_zoom", active_drag="pan",
        x_axis_label="east (km)", y_axis_label="north (km)", background_fill_color="#f4f4f4",
    )  # fmt: skip
    drawing.plot.grid.visible = False
    return drawing


def _background(plot: Any, back: Background, lines: Lines, colour: str, strength: float) -> None:
    """Draw the shaded map, as strong as is said, and lines of equal value."""
    plot.image_url(
        url=[back.picture], x=back.west, y=back.south, w=back.width, h=back.height,
        anchor="bottom_left", level="image", global_alpha=strength,
    )  # fmt: skip
    plot.line(lines.x, lines.y, line_color=colour, line_alpha=0.35, line_width=0.8)


def _tracks(drawing: Drawing, data: dict[str, Any]) -> None:
    tracks = data["tracks"]
    drawing.plot.line("x", "y", source=tracks, line_color="white", line_width=4, line_alpha=0.8)
    drawing.line(
        "unaided_y", "unaided INS", style.VERMILION, x="unaided_x", source=tracks, line_width=2,
        line_dash="dashed",
    )  # fmt: skip
    drawing.line("y", "true track", "black", x="x", source=tracks, line_width=1.6)
    drawing.line(
        "aided_y", "aided navigator", style.BLUE, x="aided_x", source=tracks, line_width=1.6
    )


def _fixes(drawing: Drawing, data: dict[str, Any]) -> None:
    from bokeh.models import HoverTool

    drawn = drawing.plot.scatter(
        "x", "y", source=data["fixes"], size=7, fill_color=style.SKY, line_color="black",
        fill_alpha="alpha", line_alpha="alpha",
        name=drawing.key("fixes", "fix", style.SKY, "disc"),
    )  # fmt: skip
    drawing.plot.add_tools(HoverTool(renderers=[drawn], tooltips="@text"))


def _now(plot: Any, data: dict[str, Any]) -> None:
    """Draw where the navigators and the vehicle are at the time of the slider."""
    plot.scatter(
        "x", "y", source=data["now"], size=11, marker="marker", fill_color="colour",
        line_color="white", line_width=1.5,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Panels:
    """What all panels over time share."""

    data: dict[str, Any]
    time: Any
    """Bokeh range of the axis of time, h."""
    cursor: Any
    """Bokeh span at the time of the slider."""
    pointer: Any
    """Bokeh span under the pointer."""

    def drawing(self, name: str, height: int, label: str, title: str, **options: Any) -> Drawing:
        """Return an empty panel."""
        from bokeh.models import CrosshairTool, Range1d

        options.setdefault("y_range", Range1d(1.0, 10.0))  # the script finds better ones
        drawing = _drawing(
            name, title, "seek(cb_obj.x)", height=height, x_range=self.time,
            tools="xpan,xwheel_zoom,xbox_zoom,reset,tap", active_drag="xbox_zoom",
            y_axis_label=label, min_border_left=72, **options,
        )  # fmt: skip
        drawing.plot.add_tools(CrosshairTool(overlay=self.pointer))
        drawing.plot.add_layout(self.cursor)
        return drawing


def _errors(shared: _Panels) -> Drawing:
    states = shared.data["states"]
    drawing = shared.drawing(
        "errors", 200, "error (m)", "Horizontal position error", y_axis_type="log"
    )
    drawing.line("unaided", "unaided INS", style.VERMILION, source=states, line_dash="dashed",
                 line_width=1.6)  # fmt: skip
    for column, colour, name in (
        ("error", style.BLUE, "aided navigator"),
        ("sigma", style.GREEN, "claimed, 1 sigma"),
        ("level", style.PURPLE, "protection level"),
    ):
        drawing.line(column, name, colour, source=states, line_width=1.6)
    return drawing


def _component(shared: _Panels, axis: str) -> Drawing:
    states = shared.data["states"]
    drawing = shared.drawing(
        axis, 150, f"{axis} (m)", f"{axis.capitalize()} error, and 3 sigma as claimed"
    )
    drawing.plot.varea(
        "t", f"{axis}_low", f"{axis}_high", source=states, fill_color=style.GREEN, fill_alpha=0.2
    )
    drawing.plot.line("t", axis, source=states, line_color=style.BLUE, line_width=1.4)
    return drawing


def _nees(shared: _Panels, interval: tuple[float, float]) -> Drawing:
    from bokeh.models import BoxAnnotation

    drawing = shared.drawing(
        "nees", 160, "NEES", "NEES per axis (1 on average)", y_axis_type="log"
    )
    drawing.plot.add_layout(
        BoxAnnotation(bottom=interval[0], top=interval[1], fill_color="#888888", fill_alpha=0.15)
    )
    drawing.line("nees", "all states", style.BLUE, source=shared.data["states"], line_width=1)
    drawing.plot.scatter(
        "t", "nees", source=shared.data["after_fixes"], size=6, fill_color=style.SKY,
        line_color="black", name=drawing.key("after", "after a fix", style.SKY, "disc"),
    )  # fmt: skip
    return drawing


def _signal(shared: _Panels, label: str) -> Drawing:
    quantity, unit = label[: label.rindex("(")].strip(), label[label.rindex("(") :]
    drawing = shared.drawing("signal", 180, unit, f"Readings against the map: {quantity}")
    readings = shared.data["readings"]
    drawing.line("truth", "map at the true place", "black", source=readings, line_width=1.2)
    drawing.line("navigator", "map at the navigator's place", style.ORANGE, source=readings,
                 line_width=1.2, line_dash="dashed")  # fmt: skip
    drawing.plot.scatter(
        "t", "reading", source=readings, size=3, fill_color=style.BLUE, line_color=None,
        name=drawing.key("reading", "reading, reduced", style.BLUE, "disc"),
    )  # fmt: skip
    return drawing


def _difference(shared: _Panels, label: str) -> Drawing:
    unit = label[label.rindex("(") :]
    drawing = shared.drawing("difference", 140, unit, "Reading minus map at the navigator's place")
    drawing.plot.line(
        "t", "difference", source=shared.data["readings"], line_color=style.BLUE, line_width=1
    )
    return drawing


def _said(shared: _Panels) -> Drawing:
    from bokeh.models import FactorRange, HoverTool

    drawing = shared.drawing(
        "said", 150, "", "Outcomes of batches, and what the nodes said",
        y_range=FactorRange(*reversed(ROWS)),
    )  # fmt: skip
    plot = drawing.plot
    drawn = plot.scatter(
        "t", "row", source=shared.data["events"], size=9, marker="marker", fill_color="colour",
        line_color="black", line_width=0.5,
    )  # fmt: skip
    plot.add_tools(HoverTool(renderers=[drawn], tooltips="@text"))
    plot.ygrid.visible = False
    plot.xaxis.axis_label = "time since start (h)"
    return drawing
