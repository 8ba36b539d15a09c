"""The posterior of a batch's shift on a grid that is refined where it matters.

The first grid covers the prior; cells that are not impossible are divided by three, until they
are smaller than half the posterior's 1-sigma. A coarse cell is not misjudged for being coarse:
where no shift on the grid is right, the noise models with larger errors take over, and the
likelihood is as wide as it should be.

Several fields along one track have one shift and noise models of their own: what the others say
is part of the prior of each."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.tracks.integrated.evidence import Surroundings, log_likelihoods, row_means
from isogal.tracks.integrated.noise_models import GRADIENT_SHARE, NoiseModels
from isogal.tracks.integrated.readings import Readings

_REACH = 3.3
"""Half-width of the grid in prior 1-sigmas."""
_CELLS = (50.0, 300.0)
"""m, smallest and largest first cells, unless the prior asks for smaller or their number for
larger ones."""
_PRIOR_SHARE = 0.12
"""First cells are at most this share of the prior's 1-sigma."""
_MOST_CELLS = 60_000
_SCREENED = 9000
"""More first cells are looked at with a few noise models only, and the likeliest go on."""
_KEPT = 900
"""Cells that are divided at most."""
_DEPTH = 30.0
"""Log density below the best at which a cell is given up."""
_LEVELS = 8
_FINE_ENOUGH = 0.5
"""Cells over the least 1-sigma of the posterior."""
_MODE_DEPTH = 8.0
"""Cells further below the best belong to no mode."""
_MODE_GAP = 150.0
"""m, modes closer than this are one."""
_DOUBT_CORRELATION = 4000.0
"""m, of what a continued map is wrong by."""


@dataclass(frozen=True, slots=True, eq=False)
class ShiftPosterior:
    """Posterior of a rigid shift on (S,) cells of one size."""

    shifts: Array
    """(S, 2) north, east, m."""
    size: float
    """m."""
    log_likelihood: Array
    """(S,) of all noise models together."""
    log_prior: Array
    """(S,) of the shift, with what other fields say of it; without its constant."""
    by_model: Array
    """(correlations, shapes, scales, offsets) posterior probabilities of the noise models."""
    models: NoiseModels
    around: Surroundings
    residual: Array
    """(m, S)."""
    readings: Readings
    mode: Integers
    """(S,) which mode each cell belongs to, the heaviest is 1; 0 = none."""
    overview: tuple[Array, Array, float]
    """Cells (S0, 2), their log posterior (S0,) and size (m) of the first grid, for display."""

    @property
    def weight(self) -> Array:
        """(S,) posterior probability of each cell."""
        return _normalised(self.log_likelihood + self.log_prior)

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean (2,) and covariance (2, 2), m."""
        mean, covariance = moments_of(self.shifts, self.weight)
        return mean, covariance + np.eye(2) * self.size**2 / 12.0

    @property
    def probability(self) -> float:
        """Of the heaviest mode."""
        return float(self.weight[self.mode == 1].sum())

    @property
    def places(self) -> int:
        """How many modes there are."""
        return int(self.mode.max(initial=0))


def moments_of(shifts: Array, weight: Array) -> tuple[Array, Array]:
    """Return mean (2,) and covariance (2, 2) of weighted shifts."""
    mean = weight @ shifts
    apart = shifts - mean
    return mean, (apart * weight[:, None]).T @ apart


def search(readings: Readings, prior: Array, models: NoiseModels) -> ShiftPosterior:
    """Return the posterior of the shift, N(0, prior (2, 2)) before the readings."""
    return search_fields(((readings, models),), prior)[0]


Fields = Sequence[tuple[Readings, NoiseModels]]
"""Readings of each field, and the noise models that they may have."""


def search_fields(fields: Fields, prior: Array) -> tuple[ShiftPosterior, ...]:
    """Return the posterior of the shift by the readings of several fields, once for each of them
    with its own likelihood."""
    cells, size = _first_cells([readings for readings, _ in fields], prior)
    precision = np.asarray(np.linalg.inv(prior), dtype=np.float64)
    screening = [(readings, models.screening) for readings, models in fields]
    overview: tuple[Array, Array, float] | None = None
    if len(cells) > _SCREENED:
        few = _at(screening, cells, size, precision, None)
        overview = few.shifts, few.total, size
        order = np.argsort(-few.total, kind="stable")
        cells = cells[np.sort(order[:_SCREENED])]
    # with the errors of where the readings turn out to be
    few = _at(screening, cells, size, precision, None)
    where = few.shifts, _normalised(few.total)
    for level in range(_LEVELS):
        state = _at(fields, cells, size, precision, where)
        if level == 0:
            overview = overview or (state.shifts, state.total, size)
        total = state.total
        where = state.shifts, _normalised(total)
        spread = moments_of(*where)[1]
        least = math.sqrt(max(float(np.linalg.eigvalsh(spread)[0]), 0.0))
        if size < _FINE_ENOUGH * least or level == _LEVELS - 1:
            break
        keep = np.flatnonzero(total > total.max() - _DEPTH)
        keep = keep[np.argsort(-total[keep], kind="stable")[:_KEPT]]
        cells, size = _divided(cells[keep]), size / 3.0
    assert overview is not None
    mode = _modes(cells, size, total)
    return tuple(state.posterior(index, size, mode, overview) for index in range(len(fields)))


@dataclass(frozen=True, slots=True, eq=False)
class _Evaluated:
    """What readings say of shifts."""

    shifts: Array
    """(S, 2)."""
    log_prior: Array
    """(S,) of the shifts."""
    fields: Fields
    residuals: list[Array]
    """(m, S) of each field."""
    likelihoods: list[Array]
    """(correlations, shapes, scales, offsets, S) of each field, of all its noise models with their
    prior."""
    around: list[Surroundings]
    """What R of each is made of: with the map's errors of where the readings probably are."""
    each: list[Array]
    """(S,) log-likelihood of each, with all noise models alike."""

    @property
    def total(self) -> Array:
        """(S,) the log posterior of each shift."""
        return self._but(None)

    def _but(self, left_out: int | None) -> Array:
        """Return the log posterior without the readings of one field."""
        total: Array | None = None
        for index, one in enumerate(self.each):
            if index != left_out:
                total = one if total is None else total + one
        return self.log_prior if total is None else total + self.log_prior

    def posterior(
        self, index: int, size: float, mode: Integers, overview: tuple[Array, Array, float]
    ) -> ShiftPosterior:
        """Return the posterior as one field has it; its likelihoods are used up."""
        total, log_prior = self.total, self._but(index)
        readings, models = self.fields[index]
        likelihoods = self.likelihoods[index]
        likelihoods += log_prior - total.max()
        by_model = np.exp(likelihoods, out=likelihoods).sum(axis=-1)
        return ShiftPosterior(
            shifts=self.shifts,
            size=size,
            log_likelihood=total - log_prior,
            log_prior=log_prior,
            by_model=by_model / by_model.sum(),
            models=models,
            around=self.around[index],
            residual=self.residuals[index],
            readings=readings,
            mode=mode,
            overview=overview,
        )


def _at(
    fields: Fields,
    cells: Integers,
    size: float,
    precision: Array,
    where: tuple[Array, Array] | None,
) -> _Evaluated:
    """Return what the readings say of shifts; `where` they probably are, else where the prior
    says."""
    shifts = np.asarray(cells * size, dtype=np.float64)
    log_prior: Array = -0.5 * np.einsum("si,ij,sj->s", shifts, precision, shifts)
    state = _Evaluated(shifts, log_prior, fields, [], [], [], [])
    for readings, models in fields:
        residual = readings.residuals(shifts)
        around = surroundings(readings, *(where or (shifts, np.exp(log_prior))))
        likelihoods = log_likelihoods(residual, models, around)
        likelihoods += models.log_prior[..., None]
        if old := readings.first_new:  # of the new readings, given the old ones
            likelihoods -= log_likelihoods(residual[:old], models, around.part(old))
        outside = ~np.isfinite(residual).all(axis=0)
        if outside.any():
            likelihoods[..., outside] = -1e6
        state.residuals.append(residual)
        state.likelihoods.append(likelihoods)
        state.around.append(around)
        state.each.append(_of_all_models(likelihoods))
    return state


def _of_all_models(likelihoods: Array) -> Array:
    """Return (S,) the log-likelihood of each shift, with all noise models alike."""
    each = likelihoods.reshape(-1, likelihoods.shape[-1])
    top = each.max(axis=0)
    share = each - top
    return np.asarray(top + np.log(np.exp(share, out=share).sum(axis=0)))


def surroundings(readings: Readings, shifts: Array, weight: Array) -> Surroundings:
    """Return what R is made of, averaged over weighted shifts (S, 2)."""
    field, doubt = readings.map.field, readings.map.doubt
    continued = readings.mean_square(doubt, shifts, weight)
    deviation = np.sqrt(continued)
    known = np.diag(readings.white + 1e-3 * continued)
    row = readings.point_row
    at_points = deviation[row]
    near = np.exp(-readings.distance / _DOUBT_CORRELATION)
    known += row_means(np.outer(at_points, at_points) * near, row)
    own = np.ones(len(readings))
    if not isinstance(field.sigma, float):
        own = readings.mean_square(field, shifts, weight)
    gradient = readings.mean_square(readings.map.rough, shifts, weight)
    gradient = gradient / max(float(gradient.mean()), 1e-300)
    mixed = (1.0 - GRADIENT_SHARE) * own + GRADIENT_SHARE * float(own.mean()) * gradient
    shapes = {"even": np.sqrt(own), "gradient": np.sqrt(mixed)}
    if not readings.own_lengths:
        return Surroundings(readings.distance, known, shapes, point_row=row)
    distance, alike = readings.in_lengths(shifts, weight)
    return Surroundings(distance, known, shapes, alike, row)


def _normalised(log_density: Array) -> Array:
    weight = np.exp(log_density - log_density.max())
    return np.asarray(weight / weight.sum())


def _first_cells(every: Sequence[Readings], prior: Array) -> tuple[Integers, float]:
    """Return the (K, 2) first cells as whole numbers, and their size, m."""
    deviation = np.sqrt(np.diag(prior))
    node = min(min(one.map.original.cell_size_m(float(np.mean(one.latitude)))) for one in every)
    least, most = _CELLS
    size = min(max(least, min(node, most)), _PRIOR_SHARE * float(deviation.min()))
    area = 4.0 * _REACH**2 * float(deviation.prod())
    size = max(size, math.sqrt(area / _MOST_CELLS))
    north, east = (np.arange(-(n := math.ceil(_REACH * d / size)), n + 1) for d in deviation)
    return np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2), size


def _divided(cells: Integers) -> Integers:
    fan = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    return (3 * cells[:, None] + fan).reshape(-1, 2)


def _modes(cells: Integers, size: float, log_posterior: Array) -> Integers:
    """Return (S,) the number of the mode that each cell belongs to, heaviest first."""
    from scipy.ndimage import binary_dilation, label

    high = log_posterior > log_posterior.max() - _MODE_DEPTH
    around = max(1, round(_MODE_GAP / size / 2.0))
    step = max(1, around // 3)  # a coarser picture does where cells are small
    index = cells // step
    index = index - index[high].min(axis=0) + around // step + 2
    shape = index[high].max(axis=0) + around // step + 3
    picture = np.zeros(shape, dtype=np.bool_)
    picture[tuple(index[high].T)] = True
    labels, count = label(binary_dilation(picture, np.ones((3, 3)), max(1, around // step)))
    inside: Booleans = ((index >= 0) & (index < shape)).all(axis=1)
    mode = np.zeros(len(cells), dtype=np.int64)
    mode[inside] = labels[tuple(index[inside].T)]
    mass = np.bincount(mode, np.exp(log_posterior - log_posterior.max()), count + 1)
    rank = np.zeros(count + 1, dtype=np.int64)
    rank[1 + np.argsort(-mass[1:], kind="stable")] = np.arange(1, count + 1)
    return rank[mode]
