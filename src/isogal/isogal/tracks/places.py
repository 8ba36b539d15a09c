"""Where a track may be: what its readings say of each shift of a grid, by every model of map and
instrument (docs/mathematics.md, section 10.2).

The first grid covers the prior; cells that are not impossible are divided by three until they are
smaller than the posterior. With R = L L' the covariance of a model's residuals r, reading t adds
-(w_t² / 2 + log L_tt), w = L⁻¹ r, to the evidence, given those before it; so that the evidence of
a part of the track is known, too."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.error_ellipses import joint
from isogal.maps.field_map import FieldMap
from isogal.maps.tensor_error import displacements, shares, tensor_covariance
from isogal.matching.pmht.models import Models
from isogal.matching.pmht.rows import Rows
from isogal.matching.pmht.search import OF_LENGTHS, residuals_at
from isogal.tracks.averaging import Averages
from isogal.tracks.continued_map import ContinuedMap
from isogal.tracks.models import SHAPES, usual_sigma

REACH = 3.3
"""Half-width of the grid in prior 1-sigmas."""
LARGEST_CELL_M, PRIOR_SHARE = 300.0, 0.12
"""First cells: at most so large, and this share of the prior's 1-sigma."""
FINE_ENOUGH, LEVELS = 0.5, 6
"""Cells over the least 1-sigma of the posterior, and grids at most."""
FEATURE_M = 2000.0
"""Over which what a map shows within a cell holds together."""
DEPTH, KEPT = 30.0, 900
"""Log density below the best at which a cell is given up, and cells that are divided at most."""
LOOKED_AT, MODELS, MODEL_DEPTH = 300, 30, 9.0
"""Cells at which all models are looked at, models that go on from there, and log of how much less
likely they may be."""
PLACE_DEPTH, PLACE_GAP_M = 8.0, 150.0
"""Log density below the best at which a cell belongs to no place, and m by which places are
apart."""
BLOCKS = 8
"""Of a track, as the jackknife leaves them out."""
GRADIENT_SHARE = 0.9
"""Of the variance of errors that go with the gradient."""
DOUBT_M = 4000.0
"""Correlation length of what a continued map is wrong by."""
NUGGET = 0.01
"""Share of a smooth error's variance that is not correlated: keeps its covariance regular."""
PLACES = 400
"""Likeliest shifts over which a map's variance is averaged."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Readings of one field, and the models that are possible."""

    readings: Rows
    """n of them, those of earlier batches first."""
    old: int
    """How many are of these."""
    rows: Averages
    """Of which m rows are means."""
    field_map: AnyMap
    around: ContinuedMap | None
    """That map, continued; None = of several channels, which is not."""
    models: Models
    apart: Array
    """(p, p, 2) m from point to point of the rows."""
    correlation: Array
    """(K, m, m) of the map's errors for each of the models' lengths, and as many smoother ones."""
    load: Array
    """(K, m, U) as `Rows.load`, of rows, for each of the models' shapes."""
    white: Array
    """(m,) variance of the noise."""
    known: Array
    """(m, m) covariance of what a continued map is wrong by where a row may be."""
    blur: Array
    """(m, m) covariance of what the map shows within a cell, for one of 1 m."""
    states: Array
    """(S, m, m) covariance that each of the instrument's states puts into rows, per unit of its
    variance at the start."""
    walked: Array
    """(m, m) the same of what has joined them since."""

    @classmethod
    def of(
        cls,
        readings: Rows,
        field_map: AnyMap,
        around: ContinuedMap | None,
        models: Models,
        potential: tuple[str, ...] | None = None,
        old: int = 0,
    ) -> "Seen":
        """Look at readings, the first `old` of which an earlier batch has used; `potential`:
        components of the tensor, where the errors of their maps come from one potential."""
        if around is not None:
            each = {name: [getattr(readings, name)] * SHAPES for name in OF_LENGTHS}
            readings = readings._replace(**{k: np.concatenate(v) for k, v in each.items()})
        one = channels_of(field_map)[0]
        node = math.sqrt(math.prod(one.cell_size_m(float(np.mean(one.latitude)))))
        rows = Averages.of(readings, node, old)
        points = rows.points
        apart = displacements(readings.latitude[points], readings.longitude[points])
        distance = np.hypot(apart[..., 0], apart[..., 1])
        every = correlations(distance, models.lengths)
        if potential is not None:
            channel = readings.channel[points]
            unit = 1.0 / np.sqrt(shares(potential))[channel]
            both = unit[:, None] * unit
            every = [
                both * tensor_covariance(potential, channel, apart, length)
                for length in models.lengths
            ]
        _, *slopes = one.value_and_gradient(readings.latitude, readings.longitude)
        square = 0.5 * float(np.nansum(np.square(slopes)) / len(readings.level))
        feature = np.exp(-distance / FEATURE_M)
        load = readings.load if potential is None else readings.load.sum(axis=2, keepdims=True)
        count = len(rows.first)
        return cls(
            readings, old, rows, field_map, around, models, apart,
            np.stack([rows.covariance(one) for one in every]),
            np.stack([rows.mean(one) for one in load]),
            rows.mean(readings.noise) / rows.sizes, np.zeros((count, count)),
            rows.covariance(feature) * square / 12.0, *_of_states(readings, rows),
        )  # fmt: skip

    def without(self, rows: Booleans) -> "Seen":
        """Return it with some rows (m,) of no weight."""
        noise = self.readings.noise.copy()
        noise[self.rows.order[np.repeat(rows, self.rows.sizes)]] *= 1e12
        readings = self.readings._replace(noise=noise)
        return replace(self, readings=readings, white=self.rows.mean(noise) / self.rows.sizes)

    @property
    def old_rows(self) -> int:
        """How many rows are of earlier batches."""
        return int(np.searchsorted(self.rows.first, self.old))

    def placed(self, centres: Array, weight: Array) -> "Seen":
        """Return it with the map's errors as they are where the track probably is, by weighted
        shifts (C, 2): as the map says or even, and as those of a map whose values are displaced,
        which go with its gradient."""
        if self.around is None:
            return self
        likely = np.argsort(-weight, kind="stable")[:PLACES]
        share, readings, rows = weight[likely] / weight[likely].sum(), self.readings, self.rows
        places = (
            readings.latitude - centres[likely, :1] * readings.radian[:, 0],
            readings.longitude - centres[likely, 1:] * readings.radian[:, 1],
        )

        def mean_square(sigma: FieldMap) -> Array:
            return np.asarray(share @ np.nan_to_num(sigma.sigma_at(*places)) ** 2)

        own = np.ones(len(readings.level))
        if not isinstance(self.around.field.sigma, float):
            own = mean_square(self.around.field) / usual_sigma(self.around.original) ** 2
        rough = mean_square(self.around.rough)
        rough *= float(own.mean()) / max(float(rough.mean()), 1e-300)
        mixed = (1.0 - GRADIENT_SHARE) * own + GRADIENT_SHARE * rough
        count = len(self.models.lengths)
        load = np.sqrt(np.tile(np.repeat([own, mixed], count, axis=0), (2, 1)))[:, :, None]
        doubt = np.sqrt(mean_square(self.around.doubt))[rows.points]
        apart = self.apart
        distance = np.hypot(apart[..., 0], apart[..., 1])
        known = np.outer(doubt, doubt) * np.exp(-distance / DOUBT_M)
        known[np.diag_indices(len(known))] += 1e-3 * doubt**2
        placed = replace(
            self,
            readings=readings._replace(load=load),
            load=np.stack([rows.mean(one) for one in load]),
            known=rows.covariance(known),
        )
        usual = self.around.field.correlation_length
        if self.around.field.error_ellipses is None or usual is None:
            return placed
        ellipses = self.around.field.error_ellipse_at(*(one[:, rows.points] for one in places))
        there = share[:, None] * np.isfinite(ellipses[..., 0])
        mean = np.einsum("ct,ctk->tk", there, np.nan_to_num(ellipses))
        mean /= np.maximum(there.sum(axis=0), 1e-12)[:, None]
        mean[~(mean > 0.0).any(axis=1)] = usual**2 * np.array([1.0, 0.0, 1.0])
        relative, alike = joint(apart, mean)
        every = [alike * one for one in correlations(usual * relative, self.models.lengths)]
        return replace(placed, correlation=np.stack([rows.covariance(one) for one in every]))

    def residuals(self, centres: Array) -> Array:
        """Return (m, C) at shifts (C, 2); NaN off the map."""
        return self.rows.mean(residuals_at(self.readings, self.field_map.grid, centres))

    def covariance(self, m: int, cell: float) -> Array:
        """Return (m, m) R of a model in cells of a size (m)."""
        models, shape = self.models, int(self.models.shape[m])
        load = self.load[shape]
        R = models.sigma[m] ** 2 * (load @ load.T)
        count = len(models.lengths)
        R *= self.correlation[shape // (2 * count) * count + shape % count]
        R += self.known + self.walked + cell**2 * self.blur
        own = models.initial[m, models.initial.shape[1] - len(self.states) :]
        R += np.tensordot(own**2, self.states, 1)
        R[np.diag_indices(len(R))] += self.white * models.noise[m]
        return np.asarray(R)

    def parts(self, centres: Array, cell: float, which: Integers) -> Array:
        """Return (M, B, C) what each block of new rows adds, given those before it, to the log
        evidence of some models at cells (C, 2); of a cell off the map, nearly -inf."""
        residual = self.residuals(centres)
        known = np.isfinite(residual).all(axis=0)
        residual = np.where(known, residual, 0.0)
        old = self.old_rows
        first = np.unique(np.arange(BLOCKS) * (len(residual) - old) // BLOCKS)
        parts = np.empty((len(which), len(first), len(centres)))
        for k, m in enumerate(which):
            factor = np.linalg.cholesky(self.covariance(m, cell))
            term = np.linalg.inv(factor) @ residual
            term *= -0.5 * term
            term -= np.log(np.diag(factor))[:, None]
            parts[k] = np.add.reduceat(term[old:], first, axis=0)
        parts[:, :, ~known] = -1e6
        return parts


def _of_states(readings: Rows, rows: Averages) -> tuple[Array, Array]:
    """Return `Seen.states` and `Seen.walked`: a state that is left with a share of what it was,
    and that something joins, from reading to reading."""
    own = slice(readings.load.shape[2], None)
    keep, fresh = readings.keep[:, own], readings.fresh[:, own]
    gone = -np.cumsum(np.log(np.maximum(keep, 1e-300)), axis=0)
    joined = np.zeros_like(fresh)
    for t in range(len(joined)) if fresh.any() else ():
        joined[t] = keep[t] ** 2 * joined[t - 1] + fresh[t]
    middle = rows.order[rows.first + rows.sizes // 2]
    gone, joined = gone[middle].T, joined[middle].T
    effect = rows.mean(readings.reading[:, BATCH_STATES:][:, own]).T
    alike = (
        effect[:, :, None] * effect[:, None] * np.exp(-np.abs(gone[:, :, None] - gone[:, None]))
    )
    earlier = np.minimum(*np.indices(2 * [len(middle)]))
    walked = (alike * joined[:, earlier]).sum(axis=0)
    return alike * np.exp(-2.0 * gone)[:, earlier], walked


def correlations(distance: Array, lengths: Array) -> list[Array]:
    """Return (p, p) of errors at distances (p, p) in m, for each of lengths (L,) in m first
    exponentials, then smoother ones with the same integral: Matern 3/2 (Rasmussen & Williams 2006,
    eq. 4.17) but for a share that is of one place alone."""
    smooth = []
    for length in lengths:
        alike = (1.0 - NUGGET) * (1.0 + 2.0 * distance / length) * np.exp(-2.0 * distance / length)
        alike[np.diag_indices(len(alike))] += NUGGET
        smooth.append(alike)
    return [np.exp(-distance / length) for length in lengths] + smooth


@dataclass(frozen=True, slots=True, eq=False)
class Shifts:
    """Posterior of a shift on (C,) cells of one size."""

    centres: Array
    """(C, 2) north, east, m."""
    size: float
    """m."""
    log_prior: Array
    """(C,) of the shift, without its constant."""
    seen: tuple[Seen, ...]
    """Of each field."""
    which: tuple[Integers, ...]
    """Of each field, (M,) the models that are possible."""
    parts: tuple[Array, ...]
    """Of each field, (M, B, C): see `Seen.parts`."""
    overview: "Shifts | None" = None
    """The first grid."""

    def by_model(self, field: int) -> Array:
        """Return (M, C) log densities of a field's readings, with the models' prior."""
        prior = self.seen[field].models.log_prior[self.which[field]]
        return np.asarray(self.parts[field].sum(axis=1) + prior[:, None])

    @property
    def log_density(self) -> Array:
        """(C,) of the shift by all readings, without its constant."""
        each = [np.logaddexp.reduce(self.by_model(f)) for f in range(len(self.seen))]
        return np.asarray(self.log_prior + sum(each))

    @property
    def weight(self) -> Array:
        """(C,) posterior probability of each cell."""
        return normalised(self.log_density)

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean (2,) and covariance (2, 2), m."""
        weight = self.weight
        mean = weight @ self.centres
        apart = self.centres - mean
        return mean, (apart * weight[:, None]).T @ apart + np.eye(2) * self.size**2 / 12.0

    @property
    def places(self) -> Array:
        """Probability of each place apart from others (P,), the heaviest first."""
        from scipy.ndimage import binary_dilation, label

        log = self.log_density
        high = log > log.max() - PLACE_DEPTH
        around = max(1, round(PLACE_GAP_M / self.size / 2.0))
        step = max(1, around // 3)  # a coarser picture does where cells are small
        index = np.rint(self.centres[high] / self.size).astype(int) // step
        around = max(1, around // step)
        index += around + 1 - index.min(axis=0)
        picture = np.zeros(index.max(axis=0) + around + 2, dtype=np.bool_)
        picture[tuple(index.T)] = True
        labels, _ = label(binary_dilation(picture, np.ones((3, 3)), around))
        share = np.bincount(labels[tuple(index.T)], self.weight[high])[1:]
        return np.asarray(np.sort(share)[::-1], dtype=np.float64)

    def of_models(self, field: int) -> Array:
        """Return (M,) the posterior probability of the models of a field (of `which`)."""
        own = self.by_model(field)
        others = self.log_density - np.logaddexp.reduce(own)
        return normalised(np.logaddexp.reduce(own + others, axis=1))


def normalised(log: Array) -> Array:
    """Return probabilities by their logs."""
    weight = np.exp(log - log.max())
    return np.asarray(weight / weight.sum())


def shifts_of(seen: Sequence[Seen], prior: Array) -> Shifts:
    """Return the posterior of a shift with a prior N(0, prior), (2, 2) m², by readings of fields
    that are independent given the shift."""
    deviation = np.sqrt(np.diag(prior))
    size = min(LARGEST_CELL_M, PRIOR_SHARE * float(deviation.min()))
    north, east = (np.arange(-(n := math.ceil(REACH * d / size)), n + 1) for d in deviation)
    cells = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
    centres = np.asarray(cells * size, dtype=np.float64)
    density = np.exp(-0.5 * np.einsum("ci,ij,cj->c", centres, np.linalg.inv(prior), centres))
    seen = [one.placed(centres, density) for one in seen]
    few = [_few(one.models) for one in seen]
    overview = shifts = _at(seen, few, cells, size, prior)
    seen = [one.placed(shifts.centres, shifts.weight) for one in seen]
    every = [np.arange(len(one.models.sigma)) for one in seen]
    best = _at(seen, every, cells[_kept(shifts.log_density, LOOKED_AT)], size, prior)
    which = [_likely(best, field) for field in range(len(seen))]
    cells = cells[_kept(shifts.log_density, len(cells))]
    for _ in range(LEVELS):
        shifts = _at(seen, which, cells, size, prior)
        if size <= FINE_ENOUGH * math.sqrt(float(np.linalg.eigvalsh(shifts.moments[1])[0])):
            break
        seen = [one.placed(shifts.centres, shifts.weight) for one in seen]
        cells = (3 * cells[_kept(shifts.log_density, KEPT)][:, None] + _FAN).reshape(-1, 2)
        size /= 3.0
    return replace(shifts, overview=overview)


_FAN = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1).reshape(-1, 2)


def _at(
    seen: Sequence[Seen], which: Sequence[Integers], cells: Integers, size: float, prior: Array
) -> Shifts:
    centres = np.asarray(cells * size, dtype=np.float64)
    log_prior = -0.5 * np.einsum("ci,ij,cj->c", centres, np.linalg.inv(prior), centres)
    parts = [one.parts(centres, size, w) for one, w in zip(seen, which, strict=True)]
    return Shifts(centres, size, log_prior, tuple(seen), tuple(which), tuple(parts))


def _kept(log: Array, most: int) -> Integers:
    order = np.argsort(-log, kind="stable")[:most]
    return order[log[order] > log[order[0]] - DEPTH]


def _likely(shifts: Shifts, field: int) -> Integers:
    """Return the models of a field that are not impossible, all where they may be of use."""
    share = np.log(np.maximum(shifts.of_models(field), 1e-300))
    order = np.argsort(-share, kind="stable")[:MODELS]
    return np.sort(shifts.which[field][order[share[order] > share[order[0]] - MODEL_DEPTH]])


def _few(models: Models) -> Integers:
    """Return models of the usual length with every second sigma, by which shifts are ranked."""
    usual = np.flatnonzero(models.length == np.sort(models.length)[len(models.length) // 2])
    sigmas = np.unique(models.sigma[usual])
    return usual[np.isin(models.sigma[usual], sigmas[::-2])]
