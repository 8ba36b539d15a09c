"""What the readings of one field say of places, by every model of map and instrument
(docs/mathematics.md, section 10.2).

Rows are means of neighbouring readings. With R = L L' the covariance of a model's residuals r, row
t adds -(w_t² / 2 + log L_tt), w = L⁻¹ r, to the evidence, given those before it; so that the
evidence of a part of the track is known, too. Of each block of the track it is as likely that its
w are standard normal as that a share of them is wider (a contaminated normal, Tukey 1960): steep
anomalies and gaps of a survey leave errors that hold half of all squares in a hundredth of the
readings."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.frames import displaced
from isogal.groups import Groups
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap, RouteMap, channels_of
from isogal.maps.error_ellipses import joint, mean_length
from isogal.maps.error_model import decay, displacements, shares, tensor_covariance
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch, SecondaryBatch
from isogal.matching.pmht.cells import FEATURE_M, in_common, residuals_at, slopes, states_at
from isogal.matching.pmht.models import Assumed, Models, assumed
from isogal.matching.pmht.rows import Rows, rows_of
from isogal.matching.pmht.states import States
from isogal.matching.quasi_random import standard_normal
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.averaging import few, neighbours
from isogal.tracks.continued_map import ContinuedMap, continued
from isogal.tracks.models import OWN, PATTERNS, SHAPES, stated_there, track_models
from isogal.tracks.track import FEWEST

MAP_REACH, POSSIBLE, SURE = 4.0, 0.05, 0.95
"""Prior 1-sigmas by which a map is continued, and share of the places possible by the prior that
must lie on the map for a reading to be used: of a map that is continued, of one that is not."""
BLOCKS = 8
"""Of a track, as the jackknife leaves them out."""
GRADIENT_SHARE = 0.9
"""Of the variance of errors that go with the gradient."""
NUGGET = 0.01
"""Share of a smooth error's variance that is not correlated: keeps its covariance regular."""
WIDE_SHARE, WIDER = 0.1, 5.0
"""Share of innovations that are wider where tails are heavy, and by which factor. Half the share
and four fifths of the factor give the same on measured lines (docs/evidence/gridding.md)."""
PLACES = 400
"""Likeliest shifts over which a map's variance is averaged."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Readings of one field, the models that are possible, and what they say of cells."""

    name: str
    """Of the field, before the names of its figures; "" = the first."""
    readings: Rows
    """n of them, those of earlier batches first."""
    old: int
    """How many are of these."""
    unused: int
    """How many others there are: off the map, or unlike the rest."""
    rows: Groups
    """Of which m rows are means."""
    points: Integers
    """(p,) readings that stand for the rows where each is compared with each."""
    field_map: AnyMap
    around: ContinuedMap | None
    """That map, continued; None = of several channels, which is not."""
    assumed: Assumed
    models: Models
    apart: Array
    """(p, p, 2) m from point to point of the rows."""
    correlation: Array
    """(K, m, m) of the map's errors for each of the models' lengths, and as many smoother ones."""
    here: float
    """Length over which errors hold together along the rows, over that of the models."""
    known: Array
    """(m, m) covariance of what a continued map is wrong by where a row may be."""
    blur: Array
    """(m, m) covariance of what the map shows within a cell, for one of 1 m."""
    instrument: Array
    """(I, m, m) covariance that the instrument's states put into rows, for each of the 1-sigmas
    that models have of them at the start."""
    of_instrument: Integers
    """(all models,) which of these a model has."""
    which: Integers
    """(M,) the models that are looked at."""
    parts: Array
    """(M, B, C) what each block of new rows adds, given those before it, to the log evidence of
    these models at C cells; of a cell off the map, nearly -inf."""
    stated: Array
    """(all models, C) what the map's own 1-sigma in each cell adds to their log prior."""

    @classmethod
    def of(cls, one: SecondaryBatch, settings: MatcherSettings, name: str) -> "Seen | None":
        """Look at a batch's readings of one field, which has a name in figures, with the models
        that are possible by a scenario's matcher section; None where too few lie on the map."""
        around, field_map = None, one.field_map
        if isinstance(field_map, FieldMap):
            reach = MAP_REACH * math.sqrt(float(np.diag(one.batch.prior)[:2].max()))
            # models of a track have noise and a constant of the readings besides
            field_map = field_map.resolved
            around = continued(field_map, reach)
        batch = on_map(one.batch, field_map, SURE if around is None else POSSIBLE)
        states = States.of(batch, field_map)
        models = track_models(settings, batch, field_map, states)
        lengths = models.lengths if around is None else np.tile(models.lengths, SHAPES)
        # what earlier batches have used counts as given
        old = int(np.isfinite(batch.reading[: len(batch) - batch.new]).sum())
        given = int(np.isfinite(one.batch.reading[-batch.new :]).sum())
        readings, _ = rows_of(replace(batch, new=len(batch)), field_map, states, lengths, None)
        if readings is None or len(readings.level) - old < FEWEST:
            return None
        unused = given + old - len(readings.level)
        field_map = field_map if around is None else around.field
        grid = channels_of(field_map)[0]
        node = math.sqrt(math.prod(grid.cell_size_m(float(np.mean(grid.latitude)))))
        rows = neighbours(readings, node, old)
        points = few(rows)
        latitude, longitude = readings.latitude[points], readings.longitude[points]
        channel = readings.channel[points]
        apart = displacements(latitude, longitude)
        distance = np.hypot(apart[..., 0], apart[..., 1])
        potential = None if batch.layout is None else batch.layout.of_one_potential
        if potential is None:
            alike = channel[:, None] == channel
            every = [alike * one for one in correlations(distance, models.lengths)]
        else:
            unit = 1.0 / np.sqrt(shares(potential))[channel]
            every = [
                np.outer(unit, unit) * tensor_covariance(potential, channel, apart, length)
                for length in models.lengths
            ]
        slope = slopes(field_map, latitude, longitude, distance)
        initial, of_instrument = np.unique(models.initial, axis=0, return_inverse=True)
        return cls(
            name, readings, old, unused, rows, points, field_map, around,
            assumed(settings, batch, field_map), models, apart,
            of_means(rows, points, every), 1.0,
            np.zeros(2 * [len(rows.first)]),
            of_means(rows, points, [slope])[0] / 6.0,
            np.stack([_of_instrument(readings, rows, one) for one in initial]),
            of_instrument.ravel(),
            np.arange(len(models.sigma)),
            np.zeros((len(models.sigma), 1, 1)),
            np.zeros((len(models.sigma), 1)),
        )  # fmt: skip

    def without(self, rows: Booleans) -> "Seen":
        """Return it with some rows (m,) of no weight."""
        out = rows[self.rows.of]
        readings = self.readings._replace(noise=np.where(out, 1e12, 1.0) * self.readings.noise)
        return replace(self, readings=readings, unused=self.unused + int(out.sum()))

    @property
    def white(self) -> Array:
        """(m,) variance of the noise."""
        return self.rows.mean(self.readings.noise) / self.rows.count

    def load(self, shape: int) -> Array:
        """Return (m,) 1-sigma of the map's error in units of a model's, for one of the models'
        shapes."""
        return self.rows.mean(self.readings.load[shape].sum(axis=1))

    @property
    def gridded(self) -> bool:
        """Whether the map says place by place over which lengths its errors hold together, as
        those of `isogal map grid` do."""
        return self.around is not None and self.around.field.error_ellipses is not None

    @property
    def length(self) -> Array:
        """(M,) over which the map's errors hold together along the rows by the models, m."""
        return self.here * self.models.length[self.which]

    @property
    def map_sigma(self) -> Array:
        """(M,) the RMS 1-sigma of the map's error along the rows by the models."""
        each = [np.sqrt(np.mean(self.load(k) ** 2)) for k in range(len(self.readings.load))]
        models, which = self.models, self.which
        return np.asarray(models.sigma[which] * np.array(each)[models.shape[which]])

    @property
    def by_model(self) -> Array:
        """(M, C) log densities of the readings, with the models' prior."""
        prior = self.models.log_prior[:, None] + self.stated
        return np.asarray(self.parts.sum(axis=1) + prior[self.which])

    @property
    def log_density(self) -> Array:
        """(C,) of the readings by all models, without its constant."""
        return np.asarray(logsumexp(self.by_model, axis=0))

    def shown(self, centre: Array) -> float:
        """Return the variance of what the map shows along the rows at a shift (1, 2)."""
        return float((self.rows.mean(self.readings.level) - self.residuals(centre)[:, 0]).var())

    @property
    def own_variance(self) -> float:
        """Mean variance of the map's error along the rows, where they probably are, as a map says
        it that has a sigma for each node; else 0."""
        if self.around is None or not self.around.uneven:
            return 0.0
        own = self.around.uneven**2 * np.mean(self.load(0) ** 2)
        return float(own + np.mean(np.diag(self.known)))

    @property
    def old_rows(self) -> int:
        """How many rows are of earlier batches."""
        return int((self.rows.first < self.old).sum())

    def placed(self, centres: Array, weight: Array) -> "Seen":
        """Return it with the map's errors as they are where the track probably is, by weighted
        shifts (C, 2): as the map says or even, and as those of a map whose values are displaced,
        which go with its gradient."""
        if self.around is None:
            return self
        likely = np.argsort(-weight, kind="stable")[:PLACES]
        share, field_map = weight[likely] / weight[likely].sum(), self.around.field
        readings, points = self.readings, self.points
        places = (
            readings.latitude - centres[likely, :1] * readings.radian[:, 0],
            readings.longitude - centres[likely, 1:] * readings.radian[:, 1],
        )

        def mean_square(nodes: float | Array) -> Array:
            return np.asarray(share @ np.nan_to_num(field_map.linear(nodes, *places)) ** 2)

        own = np.ones(len(readings.level))
        if self.around.uneven:
            own = mean_square(field_map.sigma) / self.around.uneven**2
        rough = mean_square(self.around.rough)
        rough *= float(own.mean()) / max(float(rough.mean()), 1e-300)
        mixed = (1.0 - GRADIENT_SHARE) * own + GRADIENT_SHARE * rough
        count = len(self.models.lengths)
        load = np.sqrt(np.tile(np.repeat([own, mixed, own], count, axis=0), (2, 1)))[:, :, None]
        doubt = np.sqrt(mean_square(self.around.doubt))[points]
        known = decay(np.hypot(*np.moveaxis(self.apart, -1, 0)), FEATURE_M)
        placed = replace(
            self,
            readings=readings._replace(load=load),
            known=of_means(self.rows, points, [np.outer(doubt, doubt) * known])[0],
        )
        usual = field_map.correlation_length
        if field_map.error_ellipses is None or usual is None:
            return placed
        ellipses = field_map.error_ellipse_at(*(one[:, points] for one in places))
        there = share[:, None] * np.isfinite(ellipses[..., 0])
        mean = np.einsum("ct,ctk->tk", there, np.nan_to_num(ellipses))
        mean /= np.maximum(there.sum(axis=0), 1e-12)[:, None]
        mean[~(mean > 0.0).any(axis=1)] = usual**2 * np.array([1.0, 0.0, 1.0])
        relative, alike = joint(np.moveaxis(self.apart, -1, 0), mean, mean)
        every = [alike * one for one in correlations(usual * relative, self.models.lengths)]
        here = held_together(mean_length(mean)) / usual
        return replace(placed, correlation=of_means(self.rows, points, every), here=here)

    def residuals(self, centres: Array) -> Array:
        """Return (m, C) at shifts (C, 2); NaN off the map."""
        return self.rows.mean(residuals_at(self.readings, self.field_map.grid, centres))

    def relative(self, centres: Array) -> Array:
        """Return (C,) the RMS 1-sigma along the track at shifts (C, 2) by a map that says it node
        by node, over that where the track probably is, as far as models reach; 1 of another."""
        if self.around is None or not self.around.uneven:
            return np.ones(len(centres))
        readings, field_map = self.readings, self.around.field
        square = np.zeros(len(centres))
        for t in self.points:
            north, east = (centres * readings.radian[t]).T
            place = readings.latitude[t] - north, readings.longitude[t] - east
            for nodes in (field_map.sigma, self.around.doubt):
                square += np.nan_to_num(field_map.linear(nodes, *place)) ** 2
        square /= len(self.points) * max(self.own_variance, 1e-300)
        return np.clip(np.sqrt(square), OWN[0], OWN[-1])

    def covariance(self, m: int, cell: float) -> Array:
        """Return (m, m) R of a model in cells of a size (m)."""
        models, shape = self.models, int(self.models.shape[m])
        load = models.sigma[m] * self.load(shape)
        R = np.outer(load, load)
        count = len(models.lengths)
        R *= self.correlation[shape // (PATTERNS * count) * count + shape % count]
        R += self.known + self.instrument[self.of_instrument[m]] + cell**2 * self.blur
        R[np.diag_indices(len(R))] += self.white * models.noise[m]
        return np.asarray(R)

    def at(self, centres: Array, cell: float, which: Integers) -> "Seen":
        """Return it with what some models say of cells (C, 2) of a size (m)."""
        residual = self.residuals(centres)
        known = np.isfinite(residual).all(axis=0)
        residual = np.where(known, residual, 0.0)
        old = self.old_rows
        new = len(residual) - old
        ends = np.unique([*np.arange(BLOCKS) * new // BLOCKS, new])
        blocks = np.repeat(np.eye(len(ends) - 1), np.diff(ends), axis=1)  # (B, rows): sums
        parts = np.empty((len(which), len(blocks), len(centres)))
        for k, m in enumerate(which):
            factor = np.linalg.cholesky(self.covariance(m, cell))
            term = (np.linalg.inv(factor) @ residual)[old:]
            term *= -0.5 * term
            parts[k] = np.logaddexp(blocks @ term, blocks @ with_heavy_tails(term))
            parts[k] -= (blocks @ np.log(np.diag(factor))[old:])[:, None]
        parts -= math.log(2.0)
        parts[:, :, ~known] = -1e6
        stated = stated_there(self.models, self.assumed, self.relative(centres))
        return replace(self, which=which, parts=parts, stated=stated)


def on_map(batch: Batch, field_map: RouteMap, least: float) -> Batch:
    """Return a batch without readings that less than a share of the places possible by the prior
    has on the map, unless these are more than half of those that are on it as recorded: of these,
    then, it has all.

    A matcher that takes a place off the map as impossible needs a share of `SURE`: a reading
    whose true place may lie off the map would push the fix away from there. One that continues
    the map needs `POSSIBLE`."""
    shifts = standard_normal(256, 2) @ np.linalg.cholesky(batch.prior[:2, :2]).T
    covered = field_map.covers(*displaced(batch.latitude, batch.longitude, -shifts[:, None]))
    there, new = np.isfinite(batch.reading), np.arange(len(batch)) >= len(batch) - batch.new
    recorded = there & field_map.covers(batch.latitude, batch.longitude)
    kept = there & (covered.mean(axis=0) > least)
    if (kept & new).sum() < 0.5 * (recorded & new).sum():
        kept = recorded
    return replace(batch, reading=np.where(kept, batch.reading, np.nan))


def with_heavy_tails(log_normal: Array) -> Array:
    """Return log densities of normalised innovations w, some of which are wider, where those of
    all alike are -w² / 2; both without the constant of a normal density."""
    narrower = 1.0 - 1.0 / WIDER**2
    mixed = (1.0 - WIDE_SHARE) * np.exp(narrower * log_normal)
    return np.asarray(np.log(mixed + WIDE_SHARE / WIDER) + log_normal / WIDER**2)


def of_means(rows: Groups, points: Integers, each: Sequence[Array]) -> Array:
    """Return (K, m, m) the covariances of rows by each of their points' (p, p): a covariance of
    means is one, a correlation function of their distances is not."""
    groups = Groups.by(rows.of[points])
    return np.stack([groups.mean(groups.mean(one).T) for one in each])


def held_together(length: Array) -> float:
    """Return over what length (m) errors hold together along a track on which their lengths are
    (T,) m, point by point: of two points the least on the way from one to the other, its root mean
    square over all pairs. Where a survey's readings are crossed the lengths are short, and the map
    shows what is there in its place: an error before says nothing of one behind."""
    ahead = np.triu(np.ones(2 * [len(length)], dtype=np.bool_))
    least = np.minimum.accumulate(np.where(ahead, length**2, np.inf), axis=1)[ahead].sum()
    return math.sqrt(float(2.0 * least - length @ length)) / len(length)


def _of_instrument(readings: Rows, rows: Groups, initial: Array) -> Array:
    """Return (m, m) the covariance that states of 1-sigmas (N - 7,) at the start put into rows."""
    nothing = np.zeros((len(readings.level), BATCH_STATES, BATCH_STATES))
    covariance, gone = map(rows.mean, states_at(readings, nothing, initial))
    order = rows.mean(np.arange(float(len(readings.level))))
    left = np.exp(-np.abs(gone[:, None] - gone))
    return in_common(rows.mean(readings.reading), covariance, left, order)


def correlations(distance: Array, lengths: Array) -> list[Array]:
    """Return (p, p) of errors at distances (p, p) in m, for each of lengths (L,) in m first
    exponentials, then smoother ones with the same integral: Matern 3/2 (Rasmussen & Williams 2006,
    eq. 4.17) but for a share that is of one place alone."""
    smooth = []
    for length in lengths:
        alike = (1.0 - NUGGET) * (1.0 + 2.0 * distance / length) * decay(2.0 * distance, length)
        alike[np.diag_indices(len(alike))] += NUGGET
        smooth.append(alike)
    return [decay(distance, length) for length in lengths] + smooth
