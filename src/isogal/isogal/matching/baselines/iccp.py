"""`iccp`: iterated closest contour points.

Sources: Kamgar-Parsi & Kamgar-Parsi (1999), "Vehicle localization on gravity maps", Proc. SPIE
3693:182-191; Besl & McKay (1992), "A method for registration of 3-D shapes", IEEE Trans. PAMI
14(2):239-256, for the iteration. Each scan's reading is a contour of the map; each scan's position
is pulled to the closest point of its contour; the track is moved rigidly to fit these points best;
repeat.

Chosen here: contours are found once, as crossings of a lattice over the search window; the closest
point lies on the contour's tangent at the nearest crossing; a rigid move is a translation, since
the navigator knows the direction of its track; points are weighted by the inverse variance (sigma
/ gradient)² of their contour; contours that noise may have moved by the window's width are left
out. The iteration finds the nearest minimum, so it starts from several shifts and the end with the
least residuals counts. The source gives no covariance: it is the curvature of the residuals there
(`readings.shift_covariance`) plus the spread of the ends by their likelihood, times
`covariance_factor`, since the nearest contour is not always the right one and pulls towards the
start."""

from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import (
    UsableReadings,
    publish_measured,
    shift_covariance,
)
from isogal.matching.failures import UNEXPLAINED
from isogal.matching.interfaces import Batch, Fix, declined

CELLS = 20
"""Of the lattice along the window."""
LEAST_HALF_WIDTH = 600.0
"""m, of the window."""
SHARPNESS = 0.5
"""Half-widths of the window that noise may have moved a contour by."""
START = np.linspace(-2.0, 2.0, 5)
"""Starting shifts along a side, in 1-sigma of the navigator's position."""
ITERATIONS, TOLERANCE = 50, 0.1
"""At most; m, by which a move is smaller that ends them."""
LARGEST_MISFIT = 25.0
"""Per degree of freedom, above which there is no fix."""


class IccpOptions(BaseModel):
    """Options of `iccp`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    window: float = Field(
        3.5,
        gt=0.0,
        description="half-width of the search window in 1-sigma of the navigator's position",
    )
    covariance_factor: float = Field(
        12.0,
        ge=1.0,
        description="on the covariance: nearest contours are not always the right ones",
    )
    min_scans: int = Field(
        8, ge=3, description="readings with a contour in the window that a fix needs"
    )


class Iccp(Baseline[IccpOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "iccp"
    options_model = IccpOptions
    whole = True

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        options, deviation = self.options, np.sqrt(np.diag(batch.prior)[:2])
        half = max(options.window * float(deviation.max()), LEAST_HALF_WIDTH)
        # a wrong velocity moves all contours by its Eötvös term
        wrong = readings.velocity_variance(batch.prior[2:, 2:])
        sigma = np.sqrt(readings.sigma**2 + wrong)
        contours = _crossings(readings, sigma, half)
        if (found := int((np.diff(contours.first) > 0).sum())) < options.min_scans:
            return declined(
                batch,
                f"only {found} readings have a contour in the search window ({options.min_scans}"
                " needed)",
            )
        starts = np.stack(np.meshgrid(*np.outer(deviation, START), indexing="ij"), axis=-1)
        ends = [
            _end(field_map, readings, contours, start, sigma) for start in starts.reshape(-1, 2)
        ]
        return self._assess(batch, field_map, readings, contours, ends, half)

    def _assess(
        self,
        batch: Batch,
        field_map: FieldMap,
        readings: UsableReadings,
        contours: "_Contours",
        ends: "list[_End]",
        half: float,
    ) -> Fix:
        """Return the fix of the end with the least misfit, with its covariance, or the reason for
        none."""
        misfit = np.array([end.misfit for end in ends])
        best = ends[int(np.argmin(misfit))]
        if not np.isfinite(best.misfit):
            return declined(batch, "the best track leaves the map")
        excess = max(best.misfit / (len(readings) - 2), 1.0)
        _, slope = readings.linearise(field_map, np.concatenate([best.error, [0.0, 0.0]]))
        sigma = readings.sigma * np.sqrt(excess)
        covariance = shift_covariance(slope, sigma, batch.prior[2:, 2:], 10.0 * half)
        weight = np.exp(-0.5 * (misfit - best.misfit) / excess)
        apart = np.array([end.error for end in ends]) - best.error
        covariance = covariance + np.einsum("i,ij,ik->jk", weight / weight.sum(), apart, apart)
        covariance = self.options.covariance_factor * covariance
        figures = {"misfit": excess}
        if excess > LARGEST_MISFIT:
            figures[UNEXPLAINED] = 1.0
            return declined(batch, "no track in the search window fits its contours", **figures)
        if np.linalg.eigvalsh(covariance)[1] > half**2:
            return declined(batch, "the contours leave the track free to move", **figures)
        has = best.nearest >= 0
        matched = readings.places(-contours.point[best.nearest[has]], has)
        return publish_measured(batch, best.error, covariance, figures, matched)


class _Contours(NamedTuple):
    """Points of the contours of N readings in the search window, about the navigator's position of
    each scan."""

    point: Array
    """(K, 2) m from that position."""
    tangent: Array
    """(K, 2) unit vectors along the contour."""
    variance: Array
    """(K,) m², across the contour."""
    first: Integers
    """(N + 1,) index of the first point of each reading; the points of a reading are together."""


class _End(NamedTuple):
    """Where an iteration ends."""

    error: Array
    """(2,) m, of the navigator at the batch end."""
    nearest: Integers
    """(N,) index of each reading's contour point; -1 = none."""
    misfit: float
    """Sum of squared normalised residuals; infinite off the map."""


def _end(
    field_map: FieldMap, readings: UsableReadings, contours: _Contours, start: Array, sigma: Array
) -> _End:
    """Iterate from a shift of the track (2,) m."""
    shift, nearest = _iterate(contours, start)
    # the shift moves the estimate; the error is the opposite
    residual, _ = readings.linearise(field_map, np.concatenate([-shift, [0.0, 0.0]]))
    misfit = float((residual**2 / sigma**2).sum())
    return _End(-shift, nearest, np.inf if np.isnan(misfit) else misfit)


def _crossings(readings: UsableReadings, sigma: Array, half: float) -> _Contours:
    """Return where the contour of each reading, of 1-sigma (N,), crosses a lattice of a half-width
    (m) about the navigator's position of its scan."""
    side = np.linspace(-half, half, CELLS + 1)
    lattice = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1)
    each = (len(readings), *lattice.shape)
    jacobian = readings.jacobian[:, None, None, :2]
    # at a point of the lattice the navigator's error would be the opposite
    difference, *slope = readings.compared(np.broadcast_to(-lattice, each))
    difference = difference + (jacobian * lattice).sum(axis=-1)
    both, found = np.stack(slope, axis=-1) - jacobian, []
    for axis in (1, 2):  # of lines northwards, and eastwards
        a, b = (difference.take(range(k, k + CELLS), axis) for k in range(2))
        t, i, j = np.nonzero(np.isfinite(a + b) & ((a <= 0.0) != (b <= 0.0)))
        a, b = a[t, i, j], b[t, i, j]
        share = (a / (a - b))[:, None]
        other = (t, i + (axis == 1), j + (axis == 2))
        point = (1.0 - share) * lattice[i, j] + share * lattice[other[1:]]
        across = (1.0 - share) * both[t, i, j] + share * both[other]
        found.append((t, point, across))
    t, point, across = (np.concatenate(parts) for parts in zip(*found, strict=True))
    steep = np.hypot(*across.T)
    # where noise may have moved the contour by the window's width, any contour of the window may
    # be that of the reading
    kept = np.flatnonzero(steep * SHARPNESS * half > sigma[t])
    kept = kept[np.argsort(t[kept], kind="stable")]
    t, point, across, steep = t[kept], point[kept], across[kept], steep[kept]
    tangent = np.stack([-across[:, 1], across[:, 0]], axis=-1) / steep[:, None]
    variance = (sigma[t] / steep) ** 2 + (0.1 * (side[1] - side[0])) ** 2
    return _Contours(point, tangent, variance, np.searchsorted(t, np.arange(len(readings) + 1)))


@kernel
def _iterate(contours: _Contours, start: Array) -> tuple[Array, Integers]:
    """Iterate from a shift (2,) m: the shift of the track, and the index of each scan's contour
    point (-1 = none)."""
    point, tangent, variance, first = contours
    count = first.shape[0] - 1
    shift = start.copy()
    nearest = np.full(count, -1)
    for _ in range(ITERATIONS):
        weight = pull_north = pull_east = 0.0
        for t in range(count):
            best = np.inf
            for k in range(first[t], first[t + 1]):
                apart = (point[k, 0] - shift[0]) ** 2 + (point[k, 1] - shift[1]) ** 2
                if apart < best:
                    best, nearest[t] = apart, k
            if best == np.inf:
                continue
            k = nearest[t]
            gap_north, gap_east = point[k, 0] - shift[0], point[k, 1] - shift[1]
            along = gap_north * tangent[k, 0] + gap_east * tangent[k, 1]
            w = 1.0 / variance[k]
            weight += w
            pull_north += w * (gap_north - along * tangent[k, 0])
            pull_east += w * (gap_east - along * tangent[k, 1])
        move_north, move_east = pull_north / weight, pull_east / weight
        shift[0] += move_north
        shift[1] += move_east
        if np.sqrt(move_north * move_north + move_east * move_east) < TOLERANCE:
            break
    return shift, nearest
