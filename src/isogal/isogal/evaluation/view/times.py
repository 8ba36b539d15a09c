"""The panels over time, in Bokeh: one axis of time, one line for the time of the slider, one line
under the pointer."""

from dataclasses import dataclass
from typing import Any

from isogal.evaluation.figures import style
from isogal.evaluation.view.keys import Drawing

STATES: tuple[str, ...] = (
    "t", "error", "sigma", "unaided", "level", "north", "east", "north_low", "north_high",
    "east_low", "east_high", "nees",
)  # fmt: skip
SOURCES: dict[str, tuple[str, ...]] = {
    "states": STATES,
    "after_fixes": ("t", "nees"),
    "readings": ("t", "reading", "truth", "navigator", "difference"),
    "events": ("t", "row", "colour", "marker", "text"),
}
"""Data sources of the panels and their columns."""
ROWS = ["fixes", "messages"]
"""Rows of the panel of what was said: outcomes of batches, and diagnostics."""


@dataclass(frozen=True, slots=True)
class Panels:
    """What all panels share."""

    data: dict[str, Any]
    time: Any
    """Bokeh range of the axis of time, h."""
    cursor: Any
    """Bokeh span at the time of the slider."""
    pointer: Any
    """Bokeh span under the pointer."""

    @staticmethod
    def new(end: float) -> "Panels":
        """Return what the panels of a record of `end` hours share."""
        from bokeh.models import ColumnDataSource, Range1d, Span

        data = {
            name: ColumnDataSource({column: [] for column in columns}, name=name)
            for name, columns in SOURCES.items()
        }
        margin = 0.01 * end
        return Panels(
            data,
            Range1d(0.0, end, bounds=(-margin, end + margin), name="time_range"),
            Span(location=0.0, dimension="height", line_color="black", line_width=1.5,
                 name="cursor"),
            Span(dimension="height", line_color="#888888", line_dash="dotted", line_width=1),
        )  # fmt: skip

    def drawing(self, name: str, height: int, label: str, title: str, **options: Any) -> Drawing:
        """Return an empty panel."""
        from bokeh.models import CrosshairTool, Range1d
        from bokeh.plotting import figure

        options.setdefault("y_range", Range1d(1.0, 10.0))  # the script finds better ones
        plot = figure(
            name=name, height=height, sizing_mode="stretch_width", x_range=self.time,
            tools="xpan,xwheel_zoom,xbox_zoom,reset,tap", active_drag="xbox_zoom",
            y_axis_label=label, min_border_left=72, **options,
        )  # fmt: skip
        plot.toolbar.logo = None
        plot.toolbar.autohide = True
        plot.add_tools(CrosshairTool(overlay=self.pointer))
        plot.add_layout(self.cursor)
        return Drawing(plot, title)


def panels(shared: Panels, label: str, interval: tuple[float, float]) -> list[Drawing]:
    """Return the panels.

    Parameters
    ----------
    label : str
        Quantity and unit of the readings.
    interval : pair of float
        That one state's NEES per axis stays in with 95 %.
    """
    return [
        _errors(shared),
        _component(shared, "north"),
        _component(shared, "east"),
        _nees(shared, interval),
        _signal(shared, label),
        _difference(shared, label),
        _said(shared),
    ]


def _errors(shared: Panels) -> Drawing:
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


def _component(shared: Panels, axis: str) -> Drawing:
    states = shared.data["states"]
    drawing = shared.drawing(
        axis, 150, f"{axis} (m)", f"{axis.capitalize()} error, and 3 sigma as claimed"
    )
    drawing.plot.varea(
        "t", f"{axis}_low", f"{axis}_high", source=states, fill_color=style.GREEN, fill_alpha=0.2
    )
    drawing.plot.line("t", axis, source=states, line_color=style.BLUE, line_width=1.4)
    return drawing


def _nees(shared: Panels, interval: tuple[float, float]) -> Drawing:
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


def _signal(shared: Panels, label: str) -> Drawing:
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


def _difference(shared: Panels, label: str) -> Drawing:
    unit = label[label.rindex("(") :]
    drawing = shared.drawing("difference", 140, unit, "Reading minus map at the navigator's place")
    drawing.plot.line(
        "t", "difference", source=shared.data["readings"], line_color=style.BLUE, line_width=1
    )
    return drawing


def _said(shared: Panels) -> Drawing:
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
