"""The track on the map."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style
from isogal.evaluation.records import Runs
from isogal.maps.axes import Window

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from isogal.maps.field_map import FieldMap
    from isogal.maps.tiled_map import ScalarMap


_MAP_WIDTH, _LEGEND = 5.2, 0.6
"""in, of the overview without axes and colour bar, and of the legend."""
_FLATTEST, _TALLEST = 0.3, 0.85
"""Height over width of the overview."""
_DOTS = 700
"""Rows and columns of the overview's picture of the map at most: about as many as it has dots."""


@style.journal
def track_figure(runs: Runs, field_map: "ScalarMap") -> "Figure":
    """The first run on the map: the route, the unaided navigator and the fixes."""
    frame = Frame.around(runs.latitude, np.unwrap(runs.longitude), 5e3)
    figure = style.new_figure(frame.height + _LEGEND)
    panel = figure.add_subplot()
    frame.draw(panel, field_map)
    latitude, longitude = np.degrees(runs.latitude), np.degrees(np.unwrap(runs.longitude))
    # a white edge keeps lines visible on dark and on light ground
    panel.plot(longitude, latitude, color="white", linewidth=3.2)
    panel.plot(longitude, latitude, **style.TRUTH.options(), label="true track")
    metres_north, metres_east = metres_per_radian(runs.latitude)
    panel.plot(
        longitude + np.degrees(runs.unaided_error[0, :, 1] / metres_east),
        latitude + np.degrees(runs.unaided_error[0, :, 0] / metres_north),
        **style.UNAIDED.options(),
        label="unaided INS",
    )
    metres = metres_per_radian(runs.fix_place[0])
    fixes = [
        np.degrees(place + runs.fix_error[0, :, axis] / metres[axis])
        for axis, place in enumerate(runs.fix_place)
    ]
    panel.plot(fixes[1], fixes[0], "o", **style.FIX_DOT, label="fix")
    style.legend_below(figure)
    return figure


def image_edges(nodes: Array) -> tuple[float, float]:
    """Outer edges of the cells about regular nodes, for the picture of a map."""
    half = 0.5 * float(nodes[1] - nodes[0])
    return float(nodes[0]) - half, float(nodes[-1]) + half


@dataclass(frozen=True, slots=True)
class Frame:
    """What a picture of a map shows: edges in rad, longitudes unwrapped like the track's."""

    south: float
    north: float
    west: float
    east: float
    stretch: float
    """Metres in a radian of latitude over those in one of longitude."""

    @classmethod
    def around(cls, latitude: Array, longitude: Array, margin: float) -> "Frame":
        """Frame a track, (N,) rad with longitudes that do not jump, with a margin of a tenth of
        its length, at least `margin` (m), in a shape that fills the page's width."""
        middle = [0.5 * float(x.min() + x.max()) for x in (latitude, longitude)]
        north, east = (float(m) for m in metres_per_radian(middle[0]))
        half = 0.5 * np.array([np.ptp(latitude) * north, np.ptp(longitude) * east])
        half += max(0.2 * float(np.hypot(*half)), margin)
        half[0] = max(half[0], _FLATTEST * half[1])
        half[1] = max(half[1], half[0] / _TALLEST)
        (d_lat, d_lon) = half / (north, east)
        return cls(
            *(middle[0] - d_lat, middle[0] + d_lat, middle[1] - d_lon, middle[1] + d_lon),
            stretch=north / east,
        )

    @property
    def shape(self) -> float:
        """Height over width."""
        return (self.north - self.south) * self.stretch / (self.east - self.west)

    @property
    def height(self) -> float:
        """Of the picture with its axes, in, without the legend."""
        return _MAP_WIDTH * self.shape + 0.5

    @classmethod
    def whole(cls, field_map: "FieldMap") -> "Frame":
        """Frame a map from its first node to its last."""
        per_north, per_east = metres_per_radian(float(field_map.latitude.mean()))
        axes = field_map.latitude, field_map.longitude
        south, north, west, east = (float(axis[end]) for axis in axes for end in (0, -1))
        return cls(south, north, west, east, stretch=float(per_north / per_east))

    def draw(
        self,
        panel: "Axes",
        field_map: "ScalarMap",
        label: str | None = None,
        limits: tuple[float, float] | None = None,
        *,
        titled: bool = False,
    ) -> None:
        """Draw the map in the frame, with a bar of its colours.

        Parameters
        ----------
        panel : Axes
        field_map : ScalarMap
        label : str, optional
            Of the colours; default: the map's quantity and unit.
        limits : pair of float, optional
            Of the colours, in the map's unit; default: 1 % of the values are beyond either end.
        titled : bool
            Whether the label stands above, as beside a small picture it would be too long.
        """
        window = Window(self.south, self.north, self.west, self.east)
        part = field_map.overview(_DOTS, window)
        scale = style.field_scale(part)
        values = scale(part.values)
        # the map may count its longitudes from another turn than the track
        turn = 2.0 * math.pi
        turn *= round((0.5 * (self.west + self.east) - float(part.longitude.mean())) / turn)
        south, north = image_edges(np.degrees(part.latitude))
        west, east = image_edges(np.degrees(part.longitude + turn))
        low, high = np.nanpercentile(values, [1.0, 99.0]) if limits is None else scale(limits)
        image = panel.imshow(
            values,
            extent=(west, east, south, north),
            origin="lower",
            cmap=style.FIELD_COLOURS,
            vmin=low,
            vmax=high,
            interpolation="bilinear",
            aspect=self.stretch,
        )
        bar = panel.figure.colorbar(image, ax=panel, shrink=0.9, pad=0.02, extend="both")
        (panel.set_title if titled else bar.set_label)(label or f"{scale.name} {scale.unit_label}")
        panel.grid(False)
        panel.set_facecolor("0.9")  # where there is no map
        panel.locator_params(axis="x", nbins=5)
        panel.set_xlim(math.degrees(self.west), math.degrees(self.east))
        panel.set_ylim(math.degrees(self.south), math.degrees(self.north))
        panel.set_xlabel("longitude (deg)")
        panel.set_ylabel("latitude (deg)")
