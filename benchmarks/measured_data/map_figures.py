"""The maps of docs/evidence/real-data.md with the lines that are matched against them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from isogal.arrays import Array
from isogal.evaluation.figures import style
from isogal.evaluation.figures.track import Frame
from isogal.maps.field_map import FieldMap
from isogal.tracks.figures import MATCHED, RECORDED, matched_positions
from isogal.tracks.map_error import MapError
from measured_data.clear_lake import Lake
from measured_data.lines import Line, clear_lake, scotland
from measured_data.matches import Noise, bearings, match_line
from measured_data.scotland import Part


@style.journal
def clear_lake_figure(data: Path, result: Lake) -> Figure:
    """The four lines on the map, as recorded by a navigator 3 km off and as matched; beside it,
    the map's own error."""
    field_map, lines, _ = clear_lake(data)
    figure = style.new_figure(5.2)
    left, right = figure.subplots(1, 2, sharey=True)
    _image(left, field_map, "Bouguer disturbance ($10^{-5}$ m/s²)")
    _image(right, _sigmas(field_map), r"the map's own $1\sigma$ ($10^{-5}$ m/s²)", 0.0)
    for number, line in enumerate(lines):
        fit = result["settings"][line.name]
        noise = Noise(fit["correlation_length"], fit["sensor_sigma"])
        _matched_line(left, line, field_map, noise, number == 0)
        _numbered_line(right, line, number)
    right.set_ylabel("")
    style.legend_below(figure)
    return figure


def _matched_line(panel: Axes, line: Line, field_map: FieldMap, noise: Noise, named: bool) -> None:
    """Draw a line as recorded, as matched, and where it is."""
    shift = bearings(8)[1]
    matches = match_line(line, field_map, noise, shift)
    track = line.track(1.0, shift)
    names = (
        ["as the navigator says", "as matched", "stations, where they are"] if named else ["_"] * 3
    )
    _path(panel, track.latitude, track.longitude, RECORDED, names[0])
    _path(panel, *matched_positions(track, matches), MATCHED, names[1])
    place = np.degrees(line.longitude), np.degrees(line.latitude)
    panel.plot(*place, "k.", markersize=1.8, label=names[2])


def _numbered_line(panel: Axes, line: Line, number: int) -> None:
    """Draw the stations of a line, and its number at its free end."""
    place = np.degrees(line.longitude), np.degrees(line.latitude)
    panel.plot(*place, ".", color="white", markersize=3.4)
    panel.plot(*place, ".", color="black", markersize=2.0)
    north = number in (0, 3)
    end = line.latitude.argmax() if north else line.latitude.argmin()
    panel.annotate(
        str(number),
        (math.degrees(line.longitude[end]), math.degrees(line.latitude[end])),
        xytext=(0, 7 if north else -12),
        textcoords="offset points",
        ha="center",
        fontweight="bold",
        bbox=style.LABEL_BOX,
    )


def learnt_error(part: Part) -> MapError:
    """Return the map error in the results of a group of lines over Scotland."""
    return MapError(**{k: v for k, v in part["settings"].items() if k != "even_sigma"})


@style.journal
def scotland_figure(data: Path, part: Part) -> Figure:
    """The map with flight lines and tie lines; the map error that was learnt from the flight
    lines."""
    field_map, flights, ties = scotland(data)
    own = learnt_error(part).apply(field_map)
    figure = style.new_figure(3.2)
    left, right = figure.subplots(1, 2, sharey=True)
    _image(left, field_map, "magnetic anomaly (nT)")
    _image(right, _sigmas(own), r"$1\sigma$ learnt from the flight lines (nT)", 2.0)
    for panel in (left, right):
        for group, line, label in (
            (flights, RECORDED, "flight lines (settings)"),
            (ties, MATCHED, "tie lines (matched)"),
        ):
            for number, one in enumerate(group):
                name = label if number == 0 else "_"
                _path(panel, one.latitude, one.longitude, replace(line, width=1.0), name)
        panel.set_xlim(*(math.degrees(field_map.longitude[i]) for i in (0, -1)))
        panel.set_ylim(*(math.degrees(field_map.latitude[i]) for i in (0, -1)))
    right.set_ylabel("")
    for line in ties:
        _write_error(left, line, part)
    style.legend_below(figure)
    return figure


def _write_error(panel: Axes, line: Line, part: Part) -> None:
    """Write the median error of a line's fixes at its end."""
    errors = [
        row["error_m"]
        for row in part["own"]["rows"]
        if row["line"] == line.name and "error_m" in row
    ]
    panel.annotate(
        f"{np.median(errors):.0f} m" if errors else "no fix",
        (math.degrees(line.longitude[-1]), math.degrees(line.latitude[-1])),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
        va="bottom",
        rotation=90,
        fontsize=6.5,
        annotation_clip=False,
    )


def _image(panel: Axes, field_map: FieldMap, label: str, percent: float = 1.0) -> None:
    frame = Frame.whole(field_map)
    frame.draw(panel, field_map, label, percent)
    narrow = math.degrees(frame.east - frame.west) < 1.0
    panel.xaxis.set_major_locator(MultipleLocator(0.2 if narrow else 0.5))
    panel.yaxis.set_major_locator(MultipleLocator(0.2))


def _sigmas(field_map: FieldMap) -> FieldMap:
    """Return the map of a map's own 1-sigma."""
    return replace(field_map, values=np.asarray(field_map.sigma))


def _path(panel: Axes, latitude: Array, longitude: Array, line: style.Line, label: str) -> None:
    panel.plot(
        np.degrees(longitude), np.degrees(latitude), color="white", linewidth=line.width + 1.6
    )
    panel.plot(np.degrees(longitude), np.degrees(latitude), **line.options(), label=label)
