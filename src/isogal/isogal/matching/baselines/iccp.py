"""`iccp`: iterated closest contour points.

Sources: Kamgar-Parsi & Kamgar-Parsi (1999), "Vehicle localization on gravity maps", Proc. SPIE
3693:182-191; Besl & McKay (1992), "A method for registration of 3-D shapes", IEEE Trans. PAMI
14(2):239-256, for the iteration. Each scan's reading is a contour of the map; each scan's position
is pulled to the closest point of its contour; the track is moved rigidly to fit these points best;
repeat.

Chosen here: contours are found once, as crossings of a lattice over the search window; the closest
point lies on the contour's tangent at the nearest crossing; a rigid move is a translation, or with
`rotation` also a turn about the track's centre; points are weighted by the inverse variance (sigma
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
from isogal.earth.plane import Plane
from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import (
    UsableReadings,
    publish_measured,
    shift_covariance,
)
from isogal.matching.failures import UNEXPLAINED
from isogal.matching.interfaces import Batch, Fix, declined


class IccpOptions(BaseModel):
    """Options of `iccp`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    window: float = Field(
        3.5,
        gt=0.0,
        description="half-width of the search window in 1-sigma of the navigator's position",
    )
    min_half_width: float = Field(600.0, gt=0.0, description="least half-width, m")
    lattice: int = Field(20, ge=4, le=200, description="cells of the lattice along the window")
    sharpness: float = Field(
        0.5,
        gt=0.0,
        description="largest sigma / gradient of a contour, in half-widths of the window",
    )
    starts: int = Field(
        5,
        ge=1,
        le=21,
        description="starting shifts along a side, over 2 sigma either way; 1 = one start",
    )
    rotation: bool = Field(False, description="turn the track as well")
    iterations: int = Field(50, ge=1, le=1000, description="most iterations")
    tolerance: float = Field(0.1, gt=0.0, description="m; a smaller move ends the iteration")
    covariance_factor: float = Field(
        12.0,
        ge=1.0,
        description="on the covariance: nearest contours are not always the right ones",
    )
    largest_misfit: float = Field(
        25.0, gt=1.0, description="misfit per degree of freedom above which there is no fix"
    )
    min_scans: int = Field(
        8, ge=3, description="readings with a contour in the window that a fix needs"
    )


class Iccp(Baseline[IccpOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "iccp"
    options_model = IccpOptions
    whole = True

    @property
    def fewest(self) -> int:
        """Readings that a fix needs."""
        return self.options.min_scans

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        options = self.options
        half = max(
            options.window * float(np.sqrt(np.diag(batch.prior)[:2].max())), options.min_half_width
        )
        # a wrong velocity moves all contours by its Eötvös term
        wrong = readings.velocity_variance(batch.prior[2:, 2:])
        sigma = np.sqrt(readings.arrays.sigma**2 + wrong)
        contours = _crossings(readings, sigma, half, options.lattice, options.sharpness)
        if (found := int((np.diff(contours.first) > 0).sum())) < options.min_scans:
            return declined(
                batch,
                f"only {found} readings have a contour in the search window ({options.min_scans}"
                " needed)",
            )
        arrays = readings.arrays
        plane = Plane.at(batch.latitude[-1], batch.longitude[-1])
        track = plane.metres(arrays.latitude, arrays.longitude)
        ends = [
            self._end(track, field_map, readings, contours, start, sigma)
            for start in self._starts(np.sqrt(np.diag(batch.prior)[:2]))
        ]
        return self._assess(batch, field_map, readings, contours, ends, half)

    def _starts(self, reach: Array) -> Array:
        """Return shifts (K, 2) m to start from."""
        count = self.options.starts
        side = np.linspace(-2.0, 2.0, count) if count > 1 else np.zeros(1)
        grid = np.meshgrid(side * reach[0], side * reach[1], indexing="ij")
        return np.stack(grid, axis=-1).reshape(-1, 2)

    def _end(
        self,
        track: Array,
        field_map: FieldMap,
        readings: UsableReadings,
        contours: "_Contours",
        start: Array,
        sigma: Array,
    ) -> "_End":
        """Iterate from a shift of the track (N, 2) m."""
        options = self.options
        shift, turn, nearest = _iterate(
            track, contours, start, options.rotation, options.iterations, options.tolerance
        )
        # shift and turn move the estimate; xi is the error, the opposite, at the batch end
        error = -(shift + turn * np.array([-1.0, 1.0]) * (track[-1] - track.mean(axis=0))[::-1])
        residual, _ = readings.linearise(field_map, np.concatenate([error, [0.0, 0.0]]))
        misfit = float((residual**2 / sigma**2).sum())
        return _End(error, turn, nearest, np.inf if np.isnan(misfit) else misfit)

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
        sigma = readings.arrays.sigma * np.sqrt(excess)
        covariance = shift_covariance(slope, sigma, batch.prior[2:, 2:], 10.0 * half)
        weight = np.exp(-0.5 * (misfit - best.misfit) / excess)
        apart = np.array([end.error for end in ends]) - best.error
        covariance = covariance + np.einsum("i,ij,ik->jk", weight / weight.sum(), apart, apart)
        covariance = self.options.covariance_factor * covariance
        figures = {"misfit": excess, "turn": best.turn}
        if excess > self.options.largest_misfit:
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
    turn: float
    """rad, of the track."""
    nearest: Integers
    """(N,) index of each reading's contour point; -1 = none."""
    misfit: float
    """Sum of squared normalised residuals; infinite off the map."""


def _crossings(
    readings: UsableReadings, sigma: Array, half: float, cells: int, sharpness: float
) -> _Contours:
    """Return where the contour of each reading, of 1-sigma (N,), crosses a lattice of so many
    cells about the navigator's position of its scan."""
    side = np.linspace(-half, half, cells + 1)
    lattice = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1)
    each = (len(readings), *lattice.shape)
    jacobian = readings.arrays.jacobian[:, None, None, :2]
    # at a point of the lattice the navigator's error would be the opposite
    difference, *slope = readings.compared(np.broadcast_to(-lattice, each))
    difference = difference + (jacobian * lattice).sum(axis=-1)
    both, found = np.stack(slope, axis=-1) - jacobian, []
    for axis in (1, 2):  # of lines northwards, and eastwards
        a, b = (difference.take(range(k, k + cells), axis) for k in range(2))
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
    kept = np.flatnonzero(steep * sharpness * half > sigma[t])
    kept = kept[np.argsort(t[kept], kind="stable")]
    t, point, across, steep = t[kept], point[kept], across[kept], steep[kept]
    tangent = np.stack([-across[:, 1], across[:, 0]], axis=-1) / steep[:, None]
    variance = (sigma[t] / steep) ** 2 + (0.1 * (side[1] - side[0])) ** 2
    return _Contours(point, tangent, variance, np.searchsorted(t, np.arange(len(readings) + 1)))


@kernel
def _iterate(
    track: Array,
    contours: _Contours,
    start: Array,
    rotation: bool,
    most: int,
    tolerance: float,
) -> tuple[Array, float, Integers]:
    """Iterate from a shift (2,) m: shift and turn (rad) of the track, index of each scan's contour
    point (-1 = none)."""
    point, tangent, variance, first = contours
    count = track.shape[0]
    centre_north = centre_east = 0.0
    for t in range(count):
        centre_north += track[t, 0] / count
        centre_east += track[t, 1] / count
    shift = start.copy()
    turn = 0.0
    nearest = np.full(count, -1)
    for _ in range(most):
        weight = pull_north = pull_east = moment = inertia = arm_north = arm_east = 0.0
        for t in range(count):
            lever_north, lever_east = track[t, 0] - centre_north, track[t, 1] - centre_east
            north, east = shift[0] - turn * lever_east, shift[1] + turn * lever_north
            best = np.inf
            for k in range(first[t], first[t + 1]):
                apart = (point[k, 0] - north) ** 2 + (point[k, 1] - east) ** 2
                if apart < best:
                    best, nearest[t] = apart, k
            if best == np.inf:
                continue
            k = nearest[t]
            gap_north, gap_east = point[k, 0] - north, point[k, 1] - east
            along = gap_north * tangent[k, 0] + gap_east * tangent[k, 1]
            gap_north, gap_east = (
                gap_north - along * tangent[k, 0],
                gap_east - along * tangent[k, 1],
            )
            w = 1.0 / variance[k]
            weight += w
            pull_north += w * gap_north
            pull_east += w * gap_east
            arm_north += w * lever_north
            arm_east += w * lever_east
            moment += w * (lever_north * gap_east - lever_east * gap_north)
            inertia += w * (lever_north * lever_north + lever_east * lever_east)
        move_north, move_east, more = pull_north / weight, pull_east / weight, 0.0
        if rotation:
            # small turn: normal equations of the gaps against shift and turn, shift eliminated
            spread = inertia - (arm_north * arm_north + arm_east * arm_east) / weight
            more = (moment - (arm_north * pull_east - arm_east * pull_north) / weight) / spread
            move_north += more * arm_east / weight
            move_east -= more * arm_north / weight
        shift[0] += move_north
        shift[1] += move_east
        turn += more
        reach = np.sqrt(inertia / weight)
        if (
            np.sqrt(move_north * move_north + move_east * move_east) + abs(more) * reach
            < tolerance
        ):
            break
    return shift, turn, nearest
