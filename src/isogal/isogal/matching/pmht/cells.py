"""Cells of a grid over the places where a navigator may be, ranked by one evidence with common
covariances, so that thousands are one matrix product (docs/mathematics.md, section 9.1)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.frames import horizontal_difference
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.error_model import decay
from isogal.maps.interpolation import Grid, look_up
from isogal.matching.pmht.hypotheses import NEGLIGIBLE, Hypotheses, at_same_time
from isogal.matching.pmht.models import BIASED, RARE, Models
from isogal.matching.pmht.rows import Rows, some
from isogal.matching.pmht.states import BIAS, UNKNOWN

FEATURE_M = 2000.0
"""Over which what a map shows within a cell holds together, and the size of large cells; those
that become hypotheses are half as large, and then a sixth."""
CELL_SIGMA = 1.2
"""Spacing of cells in units of a hypothesis's 1-sigma: their sum is flat to 1 %."""
PLACES = 600
"""Cells, and then hypotheses, that are followed up, at most."""
GROUPS = 120
"""Means of readings that cells are ranked by, at most: of an hour's, means over 660 m at 22 m/s.
With a third of them a place on a map of 3 mGal is found a minute later."""


@dataclass(frozen=True, slots=True, eq=False)
class Ranked:
    """Cells over the prior of an error's place, and how probable they are."""

    seen: "Seen"
    centres: Array
    """(C, 2) m, north and east."""
    size: float
    """m."""
    spread: Array
    """(2, 2) covariance of the place before any reading."""
    log_density: Array
    """(C, M) log probabilities of cells with a model, before and by the readings."""

    @classmethod
    def of(cls, seen: "Seen", spread: Array, size: float) -> "Ranked":
        """Return cells of a size (m) all over a prior N(0, spread)."""
        reach = longest(spread) * math.sqrt(-2.0 * math.log(RARE))
        count = math.ceil(reach / size)
        centres = square_of(size * np.arange(-count, count + 1.0))
        centres = centres[np.hypot(*centres.T) < reach + size]
        return cls.at(seen, centres, size, spread)

    @classmethod
    def at(cls, seen: "Seen", centres: Array, size: float, spread: Array) -> "Ranked":
        """Return cells of centres (C, 2), m, and a size (m)."""
        log = seen.log_evidence(centres, size)
        prior = log_normal(centres, spread)[:, None] + 2.0 * math.log(size)
        return cls(seen, centres, size, spread, log + prior)

    def finer(self) -> "Ranked | None":
        """Return the best cells, each divided by nine; None where they may not hold the place."""
        log = np.logaddexp.reduce(self.log_density, axis=1)
        best = _best(log, PLACES)
        if not _hold(best, log):
            return None
        size = self.size / 3.0
        ninths = square_of(np.arange(-1.0, 2.0) * size)
        centres = (self.centres[best][:, None] + ninths).reshape(-1, 2)
        return Ranked.at(self.seen, centres, size, self.spread)

    def hypotheses(self, wide: Array) -> Hypotheses | None:
        """Return those of the best cells and models about an error of covariance `wide` (7, 7);
        None where they may not hold the place."""
        states = BATCH_STATES + self.seen.models.initial.shape[1]
        best = _best(self.log_density.ravel(), round(PLACES * at_same_time(states)))
        which, model = np.divmod(best, self.log_density.shape[1])
        if not _hold(np.unique(which), np.logaddexp.reduce(self.log_density, axis=1)):
            return None
        return at_cells(self.seen.models, self.centres[which], model, self.size, wide)

    def share(self, place: Array, reach: float) -> float:
        """Return the probability of cells within a reach (m) of a place (2,)."""
        near = np.hypot(*(self.centres - place).T) < reach
        log, best = self.log_density, self.log_density.max()
        if not best > -np.inf:
            return 0.0
        # exponentials of double precision took a tenth of a look
        density = np.exp((log - best).astype(np.float32)).sum(axis=1)
        return float(density[near].sum() / density.sum())


def at_cells(
    models: Models, centres: Array, which: Integers, cell: float, wide: Array
) -> Hypotheses:
    """Return hypotheses at cells, whose weights are those of the prior.

    Parameters
    ----------
    models : Models
    centres : (K, 2) array
        Errors of the place, m north and east.
    which : (K,) array of int
        The model of each.
    cell : float
        Size of the cells, m.
    wide : (7, 7) array
        Prior covariance of the navigator's error.
    """
    gain = np.linalg.solve(wide[:2, :2], wide[:2]).T  # errors that go with a place
    inner = wide + gain @ ((cell / CELL_SIGMA) ** 2 * np.eye(2) - wide[:2, :2]) @ gain.T
    weight = log_normal(centres, wide[:2, :2]) + 2.0 * math.log(cell) + models.log_prior[which]
    return Hypotheses.of(models, which, weight, centres @ gain.T, inner)


def longest(covariance: Array) -> float:
    """Return the 1-sigma of a place of covariance (2, 2) along the longer axis of its ellipse."""
    (p, q), (_, r) = covariance.tolist()
    return math.sqrt(0.5 * (p + r) + math.hypot(0.5 * (p - r), q))


def log_normal(centres: Array, covariance: Array) -> Array:
    """Return (C,) the log density of N(0, covariance)."""
    square = np.einsum("ci,ij,cj->c", centres, np.linalg.inv(covariance), centres)
    return -0.5 * (square + np.linalg.slogdet(covariance)[1]) - math.log(2.0 * math.pi)


def _best(log: Array, most: int) -> Integers:
    """Return the best of (C,), without what is negligible; none of what is all off the map."""
    best = np.argsort(-log)[:most]
    return np.asarray(best[log[best] > log[best[0]] - NEGLIGIBLE], dtype=np.int64)


def _hold(which: Integers, log: Array) -> bool:
    """Whether some of (C,) hold what is looked for."""
    held = np.logaddexp.reduce(log[which]) if len(which) else -np.inf
    return bool(held > np.logaddexp.reduce(log) + math.log(1.0 - RARE))


def square_of(axis: Array) -> Array:
    """Return (K², 2) all pairs of values of an axis."""
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Readings, averaged in groups, and what cells are ranked by."""

    rows: Rows
    grid: Grid
    noise: Array
    """(n,) variance of the white noise."""
    filters: Mapping[float, Array]
    """(n, n) what a low-pass filter makes of what is sensed, by its time constant, s."""
    other: Array
    """(n, n) covariance of what is neither noise nor the map's error, of no cell."""
    blur: Array
    """(n, n) what is to be added to it per squared size of a cell, 1 / m²."""
    shape: Array
    """(n, n) correlation of the map's error."""
    models: Models

    @classmethod
    def of(cls, rows: Rows, since: Array, field_map: AnyMap, models: Models) -> "Seen":
        """Average rows, of whose x `since` (n, 7, 7) says what is unknown (`unaided`)."""
        size = -(-len(rows.level) // GROUPS)
        # those of a channel one after the other, the last of them in whole groups
        each = [np.flatnonzero(rows.channel == k) for k in np.unique(rows.channel)]
        which = np.concatenate([one[len(one) % size :] for one in each])

        def mean(a: Array) -> Array:
            return np.asarray(a[which].reshape(-1, size, *a.shape[1:]).mean(axis=1))

        grouped = some(rows, 0, 1)._replace(
            latitude=mean(rows.latitude), longitude=mean(rows.longitude), radian=mean(rows.radian),
            level=mean(rows.level), place=mean(rows.place), reading=mean(rows.reading),
            load=np.stack([mean(one) for one in rows.load]), added=mean(rows.added),
            channel=rows.channel[which[::size]],
        )  # fmt: skip
        apart = horizontal_difference(
            grouped.latitude[:, None], grouped.longitude[:, None],
            grouped.latitude, grouped.longitude,
        )  # fmt: skip
        distance = np.hypot(apart[..., 0], apart[..., 1])
        slope = slopes(field_map, grouped.latitude, grouped.longitude, distance)
        noise = mean(rows.noise) / size
        other = np.zeros((len(noise), len(noise)))
        covariance, gone = map(mean, states_at(rows, since, models.initial[0]))
        left = np.exp(-np.abs(gone[:, None] - gone))
        order = mean(np.arange(float(len(rows.level))))
        for effect, unit in (
            (grouped.reading, 1.0), (grouped.place[:, 0], slope), (grouped.place[:, 1], slope)
        ):  # fmt: skip
            other += unit * in_common(effect, covariance, left, order)
        time = mean(np.cumsum(rows.elapsed))
        filters = {lag: low_pass(time, lag) for lag in np.unique(models.lag).tolist()}
        load = grouped.load[models.shape[0]]
        shape = decay(distance, models.length[0]) * (load @ load.T)
        return cls(grouped, field_map.grid, noise, filters, other, slope / 6.0, shape, models)

    def log_evidence(self, centres: Array, cell: float) -> Array:
        """Return (C, M) log evidence of readings in cells of centres (C, 2) and a size (m), with
        the models' prior; -inf off the map.

        All models have one correlation length: with D the covariance of what is not the map's
        error and E the correlation of that, both are diagonal in the eigenvectors of E relative to
        D, and for each group of models the residuals are turned once for all sigmas. Of what is
        sensed, s, a filter F makes y = F s + noise: with residuals r = y - s that would be, were
        there none, y - F s = y - F y + F r."""
        models = self.models
        log = np.empty((len(centres), len(models.sigma)))
        residual = residuals_at(self.rows, self.grid, centres).astype(np.float32)
        for group in np.unique(models.group):
            which = np.flatnonzero(models.group == group)
            F = self.filters[models.lag[which[0]]]
            D = F @ (self.other + cell**2 * self.blur) @ F.T
            D += np.diag(models.noise[which[0]] * self.noise)
            if models.family[which[0]] == BIASED:  # passes a filter as it is
                D += models.initial[which[0], BIAS - len(UNKNOWN)] ** 2
            factor = np.linalg.inv(np.linalg.cholesky(D))
            through = factor @ F
            values, vectors = np.linalg.eigh(through @ self.shape @ through.T)
            y = self.rows.level - self.rows.added
            turned = (vectors.T @ through).astype(np.float32) @ residual
            turned += (vectors.T @ (factor @ (y - F @ y))).astype(np.float32)[:, None]
            variance = 1.0 + np.outer(models.sigma[which] ** 2, np.maximum(values, 0.0))
            constant = models.log_prior[which] - 0.5 * np.log(variance).sum(axis=1)
            constant += np.log(np.diag(factor)).sum()
            log[:, which] = constant - 0.5 * (turned.T**2 @ (1.0 / variance.T).astype(np.float32))
        log[~np.isfinite(log)] = -np.inf
        return log


def low_pass(time: Array, lag: float) -> Array:
    """Return (n, n) what a first-order filter of a time constant (s) gives at times (n,) of what
    is sensed there, that being linear in between and having been the same before; rows sum to
    1."""
    F = np.eye(len(time))
    for k in range(1, len(time) if lag > 0.0 else 0):
        elapsed = max(time[k] - time[k - 1], 1e-6 * lag)  # readings of one time
        left = math.exp(-elapsed / lag)
        older = (1.0 - left) * lag / elapsed
        F[k, :k] = left * F[k - 1, :k]
        F[k, k - 1] += older - left
        F[k, k] = 1.0 - older
    return F


def slopes(field_map: AnyMap, latitude: Array, longitude: Array, distance: Array) -> Array:
    """Return (n, n) covariance of the map's gradient along one axis at places (n,), rad, which are
    distances (n, n) in m apart; squared unit / m."""
    _, *each = channels_of(field_map)[0].value_and_gradient(latitude, longitude)
    square = np.square(each).sum(axis=0)
    known = square[np.isfinite(square)]
    return decay(distance, FEATURE_M) * (0.5 * known.mean() if len(known) else 0.0)


def in_common(effect: Array, covariance: Array, left: Array, order: Array) -> Array:
    """Return (n, n) the covariance that states put into rows.

    Parameters
    ----------
    effect : (n, S) array
        What the states put into each row.
    covariance : (n, S, S) array
        Of the states, as they are at each row.
    left : (n, n, S) array
        The share of each state at one of two rows that is left at the other.
    order : (n,) array
        Grows with time: what joins the states at a row, later ones have too.
    """
    across = (np.einsum("ti,tij->tj", effect, covariance)[:, None] * left * effect).sum(axis=2)
    return np.asarray(np.where(order[:, None] <= order, across, across.T))


def states_at(rows: Rows, since: Array, initial: Array) -> tuple[Array, Array]:
    """Return of all states of rows but the map's errors `covariance` of `in_common`, and (n, S)
    the negative log of the share of each state's first value that is left, by what is unknown of x
    at each of them (n, 7, 7) and 1-sigmas before the first one of the others."""
    n, first = BATCH_STATES, BATCH_STATES + rows.load.shape[2]
    covariance = np.zeros((len(since), n + len(initial), n + len(initial)))
    covariance[:, :n, :n] = since
    gone, now = np.zeros(covariance.shape[:2]), initial**2
    gone[:, n:] = -np.cumsum(np.log(np.maximum(rows.keep, 1e-300)), axis=0)
    diagonal = np.arange(first, n + len(initial))
    for t in range(len(since)):
        now = now * rows.keep[t] ** 2 + rows.fresh[t]
        covariance[t, diagonal, diagonal] = now[first - n :]
    return covariance, gone


def residuals_at(rows: Rows, grid: Grid, centres: Array) -> Array:
    """Return (n, C) readings less the map where navigators with errors (C, 2) of their place would
    be, and less what these put into them; NaN off the map."""
    out = np.empty((len(rows.level), len(centres)))
    row, column = np.empty((2, len(centres)), dtype=np.int64)
    errors = np.ascontiguousarray(centres.T)
    for t, there in enumerate(out):
        north, east = (rows.place[t, :, :2] * rows.radian[t][:, None]) @ errors
        lat, lon = rows.latitude[t] - north, rows.longitude[t] - east
        look_up(grid, lat, lon, rows.channel[t], row, column, there)
        there[:] = rows.level[t] - rows.reading[t, :2] @ errors - there
    return out
