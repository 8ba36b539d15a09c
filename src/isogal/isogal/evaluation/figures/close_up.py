"""One batch end on the map: candidates, fix and navigator, in kilometres from the truth."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style
from isogal.evaluation.records import Runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

    from isogal.maps.tiled_map import ScalarMap


_LATTICE = 90
"""Points along each side of the picture of the map."""
_AROUND = 600.0
"""s of the tracks before and after the batch end."""
_TICKS = 5
"""Of each axis: as many labels of three digits as stand apart below three panels side by side."""
_FIX = style.Line("black", (0, (3, 1.5)), 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class BatchEnd:
    """The end of a batch of the first run, and where the vehicle truly is then."""

    runs: Runs
    batch: int
    time: float
    """s."""
    latitude: float
    """rad."""
    longitude: float
    """rad, unwrapped like the route's."""
    metres: Array
    """(2,) metres per radian of latitude and longitude."""

    @classmethod
    def of(cls, runs: Runs, batch: int) -> "BatchEnd":
        """Return the end of a batch, by its index."""
        latitude, longitude = (float(axis[batch]) for axis in runs.fix_place)
        metres = np.array([float(m) for m in metres_per_radian(latitude)])
        return cls(runs, batch, float(runs.fix_time[batch]), latitude, longitude, metres)

    @property
    def published(self) -> bool:
        """Whether the batch gave a fix."""
        return bool(self.runs.published[0, self.batch])

    @property
    def claims(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Error (2,) and covariance (2, 2) of the navigator after the batch, and of the fix."""
        runs, batch = self.runs, self.batch
        return (
            (runs.posterior_error[0, batch], runs.posterior_covariance[0, batch]),
            (runs.fix_error[0, batch], runs.fix_covariance[0, batch]),
        )

    def candidates(self) -> tuple[Array, Array]:
        """Return (N, 2) m north and east of the truth and (N,) weights of the batch's candidates.

        Those of the last scan alone where the matcher gives them for it: they belong to the place
        that the close-up shows."""
        detail = self.runs.detail
        if detail is None:
            return np.empty((0, 2)), np.empty(0)
        mine = detail.candidate_batch == self.batch
        last = mine & (detail.candidate_scan == detail.candidate_scan.max(initial=-1))
        mine = last if last.any() else mine
        offset = np.stack(
            [
                detail.candidate_latitude[mine] - self.latitude,
                detail.candidate_longitude[mine] - self.longitude,
            ],
            axis=1,
        )
        offset[:, 1] = np.remainder(offset[:, 1] + math.pi, 2.0 * math.pi) - math.pi
        return offset * self.metres, detail.candidate_weight[mine]

    def track(self, error: Array | float) -> tuple[Array, Array]:
        """Return the true track about the batch end plus an error (K, 2), m north and east of the
        truth at the batch end."""
        runs = self.runs
        near = np.abs(runs.time - self.time) <= _AROUND
        moved = np.broadcast_to(error, (runs.time.size, 2))[near]
        north = (runs.latitude[near] - self.latitude) * self.metres[0] + moved[:, 0]
        east = (np.unwrap(runs.longitude)[near] - self.longitude) * self.metres[1] + moved[:, 1]
        return north, east


def close_up(panel: "Axes", end: BatchEnd, field_map: "ScalarMap", letter: str) -> None:
    """Draw one batch end.

    Parameters
    ----------
    panel : Axes
    end : BatchEnd
    field_map : ScalarMap
    letter : str
        By which the picture of the whole route names it.
    """
    runs = end.runs
    candidates, weights = end.candidates()
    half = _half_width(end, candidates)
    km, values, image = surroundings(panel, (end.latitude, end.longitude), field_map, half)
    image.set_alpha(0.55)
    if np.isfinite(values).sum() > 4:
        panel.contour(km, km, values, levels=10, colors="0.45", linewidths=0.4)
    if candidates.size:
        panel.scatter(
            candidates[:, 1] / 1e3,
            candidates[:, 0] / 1e3,
            s=4.0 + 26.0 * weights / max(float(weights.max()), 1e-300),
            marker="+",
            color=style.BLUE,
            linewidths=0.8,
            label="candidates",
        )
    for error, line in (
        (0.0, style.TRUTH),
        (runs.unaided_error[0], style.UNAIDED),
        (runs.error[0], style.Line(style.AIDED.colour, "-", 0.8)),
    ):
        north, east = end.track(error)
        panel.plot(east / 1e3, north / 1e3, **line.options())
    after, fix = end.claims
    _ellipse(panel, *after, style.AIDED, r"navigator, $3\sigma$")
    if end.published:
        _ellipse(panel, *fix, _FIX, r"fix, $3\sigma$")
        panel.plot(fix[0][1] / 1e3, fix[0][0] / 1e3, "o", **style.FIX_DOT)
    panel.plot(0.0, 0.0, "x", color="black", markersize=5, label="truth (batch end)")
    ticks = np.linspace(-half / 1e3, half / 1e3, _TICKS)
    panel.set(xticks=ticks, yticks=ticks, xlim=ticks[[0, -1]], ylim=ticks[[0, -1]])
    panel.set_aspect("equal")
    panel.grid(False)
    status = "" if end.published else ", no fix"
    panel.set_title(f"{letter}  {(end.time - runs.time[0]) / 60:.0f} min{status}", loc="left")
    panel.set_xlabel("east (km)")


def image_edges(nodes: Array) -> tuple[float, float]:
    """Outer edges of the cells about regular nodes, for the picture of a map."""
    half = 0.5 * float(nodes[1] - nodes[0])
    return float(nodes[0]) - half, float(nodes[-1]) + half


def surroundings(
    panel: "Axes", place: tuple[float, float], field_map: "ScalarMap", half: float
) -> tuple[Array, Array, "AxesImage"]:
    """Draw the map about a place; return the lattice along each axis (N,) km, the map's values
    there (N, N) as they are written on an axis, and the picture.

    Parameters
    ----------
    panel : Axes
        In km east and north of the place.
    place : tuple of float
        Latitude and longitude, rad.
    field_map : ScalarMap
    half : float
        m, from the place to the edges.
    """
    lattice = np.linspace(-half, half, _LATTICE)
    north, east = np.meshgrid(lattice, lattice, indexing="ij")
    metres = metres_per_radian(place[0])
    values = field_map.value(place[0] + north / metres[0], place[1] + east / metres[1])
    scaled = style.field_scale(field_map)(values)
    edges = image_edges(lattice / 1e3)
    image = panel.imshow(
        scaled,
        extent=(*edges, *edges),
        origin="lower",
        cmap=style.FIELD_COLOURS,
        interpolation="bilinear",
    )
    return lattice / 1e3, scaled, image


def _half_width(end: BatchEnd, candidates: Array) -> float:
    """Distance (m) from the centre to the edge, so that the 3-sigma ellipses of batch and
    navigator, and their errors, fit in."""
    reaches = [200.0]
    for error, covariance in end.claims:
        reach = float(
            np.abs(error).max() + 3.2 * math.sqrt(max(covariance[0, 0], covariance[1, 1]))
        )
        if math.isfinite(reach):
            reaches.append(reach)
    near = np.abs(candidates).max(axis=1, initial=0.0)
    near = near[near <= 4.0 * max(reaches)]  # those further out would make the rest too small
    return style.nice_limit(min(max([*reaches, *(1.05 * near)]), 2e4))


def _ellipse(
    panel: "Axes", centre: Array, covariance: Array, line: style.Line, label: str
) -> None:
    """Draw the 3-sigma ellipse of a north-east covariance (m²)."""
    if not (np.isfinite(centre).all() and np.isfinite(covariance).all()):
        return
    if np.linalg.eigvalsh(covariance)[0] < 0.0:
        return
    edge = centre + style.ellipse(covariance, 3.0)
    panel.plot(edge[:, 1] / 1e3, edge[:, 0] / 1e3, **line.options(), label=label)
