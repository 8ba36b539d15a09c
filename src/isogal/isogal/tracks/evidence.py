"""What the readings of one field say of places, by every model of map and instrument
(docs/mathematics.md, section 10.2).

Rows are means of neighbouring readings. With R = L L' the covariance of a model's residuals r, row
t adds -(w_t² / 2 + log L_tt), w = L⁻¹ r, to the evidence, given those before it; so that the
evidence of a part of the track is known, too. Of each block of the track it is as likely that its
w are standard normal as that a share of them is wider (a contaminated normal, Tukey 1960): steep
anomalies and gaps of a survey leave errors that hold half of all squares in a hundredth of the
readings."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.error_ellipses import joint
from isogal.maps.error_model import decay, displacements, shares, tensor_covariance
from isogal.maps.field_map import FieldMap
from isogal.matching.pmht.cells import FEATURE_M, in_common, residuals_at, slopes, states_at
from isogal.matching.pmht.models import Models
from isogal.matching.pmht.rows import OF_LENGTHS, Rows
from isogal.tracks.averaging import Averages
from isogal.tracks.continued_map import ContinuedMap
from isogal.tracks.models import SHAPES

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
    known: Array
    """(m, m) covariance of what a continued map is wrong by where a row may be."""
    blur: Array
    """(m, m) covariance of what the map shows within a cell, for one of 1 m."""
    instrument: Array
    """(I, m, m) covariance that the instrument's states put into rows, for each of the 1-sigmas
    that models have of them at the start."""
    which: Integers
    """(M,) which of these a model has."""

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
        channel = readings.channel[points]
        if potential is None:
            alike = channel[:, None] == channel
            every = [alike * one for one in correlations(distance, models.lengths)]
        else:
            unit = 1.0 / np.sqrt(shares(potential))[channel]
            every = [
                np.outer(unit, unit) * tensor_covariance(potential, channel, apart, length)
                for length in models.lengths
            ]
        slope = slopes(field_map, readings.latitude[points], readings.longitude[points], distance)
        initial, which = np.unique(models.initial, axis=0, return_inverse=True)
        return cls(
            readings, old, rows, field_map, around, models, apart,
            np.stack([rows.covariance(one) for one in every]),
            np.zeros(2 * [len(rows.first)]),
            rows.covariance(slope) / 6.0,
            np.stack([_of_instrument(readings, rows, one) for one in initial]),
            which.ravel(),
        )  # fmt: skip

    def without(self, rows: Booleans) -> "Seen":
        """Return it with some rows (m,) of no weight."""
        noise = self.readings.noise.copy()
        noise[self.rows.order[np.repeat(rows, self.rows.sizes)]] *= 1e12
        return replace(self, readings=self.readings._replace(noise=noise))

    @property
    def white(self) -> Array:
        """(m,) variance of the noise."""
        return self.rows.mean(self.readings.noise) / self.rows.sizes

    def load(self, shape: int) -> Array:
        """Return (m,) 1-sigma of the map's error in units of a model's, for one of the models'
        shapes."""
        return self.rows.mean(self.readings.load[shape].sum(axis=1))

    @property
    def gridded(self) -> bool:
        """Whether the map says place by place over which lengths its errors hold together, as
        those of `isogal map grid` do."""
        return self.around is not None and self.around.field.error_ellipses is not None

    def map_sigma(self, which: Integers) -> Array:
        """Return (M,) the RMS 1-sigma of the map's error along the rows by some models."""
        each = [np.sqrt(np.mean(self.load(k) ** 2)) for k in range(len(self.readings.load))]
        return np.asarray(self.models.sigma[which] * np.array(each)[self.models.shape[which]])

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
        if self.around.uneven:
            own = mean_square(self.around.field) / self.around.uneven**2
        rough = mean_square(self.around.rough)
        rough *= float(own.mean()) / max(float(rough.mean()), 1e-300)
        mixed = (1.0 - GRADIENT_SHARE) * own + GRADIENT_SHARE * rough
        count = len(self.models.lengths)
        load = np.sqrt(np.tile(np.repeat([own, mixed], count, axis=0), (2, 1)))[:, :, None]
        doubt = np.sqrt(mean_square(self.around.doubt))[rows.points]
        known = decay(np.hypot(*np.moveaxis(self.apart, -1, 0)), FEATURE_M)
        placed = replace(
            self,
            readings=readings._replace(load=load),
            known=rows.covariance(np.outer(doubt, doubt) * known),
        )
        usual = self.around.field.correlation_length
        if self.around.field.error_ellipses is None or usual is None:
            return placed
        ellipses = self.around.field.error_ellipse_at(*(one[:, rows.points] for one in places))
        there = share[:, None] * np.isfinite(ellipses[..., 0])
        mean = np.einsum("ct,ctk->tk", there, np.nan_to_num(ellipses))
        mean /= np.maximum(there.sum(axis=0), 1e-12)[:, None]
        mean[~(mean > 0.0).any(axis=1)] = usual**2 * np.array([1.0, 0.0, 1.0])
        relative, alike = joint(self.apart, mean)
        every = [alike * one for one in correlations(usual * relative, self.models.lengths)]
        return replace(placed, correlation=np.stack([rows.covariance(one) for one in every]))

    def residuals(self, centres: Array) -> Array:
        """Return (m, C) at shifts (C, 2); NaN off the map."""
        return self.rows.mean(residuals_at(self.readings, self.field_map.grid, centres))

    def covariance(self, m: int, cell: float) -> Array:
        """Return (m, m) R of a model in cells of a size (m)."""
        models, shape = self.models, int(self.models.shape[m])
        load = models.sigma[m] * self.load(shape)
        R = np.outer(load, load)
        count = len(models.lengths)
        R *= self.correlation[shape // (2 * count) * count + shape % count]
        R += self.known + self.instrument[self.which[m]] + cell**2 * self.blur
        R[np.diag_indices(len(R))] += self.white * models.noise[m]
        return np.asarray(R)

    def parts(self, centres: Array, cell: float, which: Integers) -> Array:
        """Return (M, B, C) what each block of new rows adds, given those before it, to the log
        evidence of some models at cells (C, 2); of a cell off the map, nearly -inf."""
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
        return parts


def with_heavy_tails(log_normal: Array) -> Array:
    """Return log densities of normalised innovations w, some of which are wider, where those of
    all alike are -w² / 2; both without the constant of a normal density."""
    narrower = 1.0 - 1.0 / WIDER**2
    mixed = (1.0 - WIDE_SHARE) * np.exp(narrower * log_normal)
    return np.asarray(np.log(mixed + WIDE_SHARE / WIDER) + log_normal / WIDER**2)


def _of_instrument(readings: Rows, rows: Averages, initial: Array) -> Array:
    """Return (m, m) the covariance that states of 1-sigmas (N - 7,) at the start put into rows."""
    nothing = np.zeros((len(readings.level), BATCH_STATES, BATCH_STATES))
    covariance, gone = map(rows.mean, states_at(readings, nothing, initial))
    order = rows.mean(np.arange(float(len(readings.level))))
    return in_common(rows.mean(readings.reading), covariance, gone, order)


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
