"""The two maps of the page, in Bokeh: the whole route, and the surroundings of the vehicle at the
time of the slider. The page's script fills the data sources, which it finds by name."""

from typing import Any

from isogal.evaluation.figures import style
from isogal.evaluation.view.background import Background, Lines
from isogal.evaluation.view.keys import Drawing

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
}
"""Data sources of the maps and their columns."""


def sources() -> dict[str, Any]:
    """Return empty data sources by name."""
    from bokeh.models import ColumnDataSource

    return {
        name: ColumnDataSource({column: [] for column in columns}, name=name)
        for name, columns in SOURCES.items()
    }


def overview(back: Background, data: dict[str, Any], label: str) -> Drawing:
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


def close_up(back: Background, data: dict[str, Any]) -> Drawing:
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
    from bokeh.plotting import figure

    plot = figure(
        name=name, height=400, sizing_mode="stretch_width",
        x_range=Range1d(-5, 5), y_range=Range1d(-5, 5), match_aspect=True,
        tools="pan,wheel_zoom,box_zoom,reset,tap", active_scroll="wheel_zoom", active_drag="pan",
        x_axis_label="east (km)", y_axis_label="north (km)", background_fill_color="#f4f4f4",
    )  # fmt: skip
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    plot.grid.visible = False
    return Drawing(plot, title)


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
