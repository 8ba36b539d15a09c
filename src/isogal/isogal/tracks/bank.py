"""The bank of hypotheses on a recorded track: from a batch of readings to a fix.

No navigator says how wrong a track is, so that it may be anywhere within a prior of kilometres.
Where it may be is looked up on a grid of shifts first (`places`); cells and models that are not
impossible become hypotheses of the bank (`isogal.matching.pmht`), which take the readings as they
do on a vehicle. How far the fix moves without half of the readings widens it (`jackknife`)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap
from isogal.maps.field_map import FieldMap
from isogal.matching.information import likelihood_information, measurement_only
from isogal.matching.interfaces import Batch, Beside, Fix, Information, declined
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.models import BIAS_SHARE, BIASED, NONE, Fault, Models, models_of
from isogal.matching.pmht.rows import States, navigator_states, rows_of
from isogal.matching.pmht.search import at_cells
from isogal.matching.pmht.settings import Settings
from isogal.matching.quasi_random import standard_normal
from isogal.matching.usability import too_few, unusable
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.batches import without_map_edge
from isogal.tracks.continued_map import continued
from isogal.tracks.jackknife import excess
from isogal.tracks.places import Seen, Shifts, shifts_of

FEWEST_READINGS = 3
FAULTS = (Fault(NONE, 0.5), Fault(BIASED, 0.5, bias=1.0))
"""Of a track's readings: an unknown constant is as likely as not."""
REMEMBERED = 0.8
"""Share of the next batch's prior of models that comes from the batches before."""
OUTLIER_SIGMA, MOST_OUTLIERS, ROUNDS = 6.0, 0.1, 3
"""Beyond which a reading, predicted from all others, is left out; the share that may be, and how
often they are looked for."""
MAP_REACH, LEAST_ON_MAP = 4.0, 0.05
"""Prior 1-sigmas by which a map is continued, and share of the places possible by the prior that
must lie on the map for a reading to be used."""
PAIRS, PAIR_DEPTH = 3000, 14.0
"""Cells with a model that become hypotheses, and log of how much less likely they may be."""


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What is carried from batch to batch."""

    log_prior: tuple[Array | None, ...] = ()
    """Of each field that of its models; None = nothing is learnt."""
    shifts: Shifts | None = None
    """Of the last batch, for display."""


@dataclass(frozen=True)
class TrackMatcher:
    """Matches batches of recorded tracks, each by itself but for what is learnt of the models."""

    settings: tuple[Settings, ...]
    """Of each field."""
    names: tuple[str, ...]
    constant: tuple[bool, ...]
    """Of each field, whether its readings may have an unknown constant that nobody has told."""
    checked: bool = True
    """Whether the jackknife widens fixes."""
    name: str = "pmht"
    context: int = 0
    takes_channels: bool = True

    @classmethod
    def of_fields(
        cls, matchers: Sequence[MatcherSettings], names: Sequence[str], checked: bool = True
    ) -> "TrackMatcher":
        """Build it from matcher sections; raises InputError on a bad option."""
        constant = tuple("bias_sigma" not in one.model_fields_set for one in matchers)
        return cls(tuple(Settings.of(one) for one in matchers), tuple(names), constant, checked)

    def match(
        self, batch: Batch, field_map: AnyMap, memory: Memory | None
    ) -> tuple[Fix, Memory]:
        """Match one batch; see `interfaces.Matcher`."""
        memory = replace(memory or Memory((None,) * len(self.settings)), shifts=None)
        if reason := unusable(batch):
            return declined(batch, reason), memory
        each = (Beside(0, batch, field_map), *batch.beside)
        found = [(one, self._seen(one, memory)) for one in each]
        fields = [one for one, seen in found if seen is not None]
        if not fields:
            return declined(batch, too_few(batch, 0, FEWEST_READINGS) or "no readings"), memory
        prior, _ = navigator_states(batch)
        shifts = without_outliers([seen for _, seen in found if seen is not None], prior[:2, :2])
        if not shifts.log_density.max() > -1e5:
            return declined(batch, "none of the likely places is on the map"), memory
        mean, covariance = posterior(shifts, prior)
        return self._fix(batch, prior, shifts, (mean, covariance)), self._after(
            memory, fields, shifts
        )

    def _seen(self, one: Beside, memory: Memory) -> Seen | None:
        batch, field_map = one.batch, one.field_map
        around = None
        if isinstance(field_map, FieldMap):
            reach = MAP_REACH * math.sqrt(float(np.diag(batch.prior)[:2].max()))
            around = continued(field_map, reach)
            batch = where_possible(batch, field_map)
        else:
            batch = without_map_edge(batch, field_map)
        states = States.of(batch, field_map)
        models = self._models(one, states)
        rows, _ = rows_of(batch, field_map, states, models.lengths, None)
        if rows is None or len(rows.level) < FEWEST_READINGS:
            return None
        if around is None:
            return Seen.of(rows, field_map, None, models)
        rows = rows._replace(load=np.concatenate([rows.load, rows.load]))
        models = both_shapes(models)
        learnt = memory.log_prior[one.field]
        if learnt is not None and learnt.shape == models.log_prior.shape:
            models = models._replace(log_prior=learnt)
        return Seen.of(rows, around.field, around, models)

    def _models(self, one: Beside, states: States) -> Models:
        assumed = self.settings[one.field].assumed(one.batch, one.field_map)
        if not self.constant[one.field]:
            return models_of(assumed, states, FAULTS[:1])
        if assumed.sigma == 0.0 or assumed.trust == 1.0:
            assumed = replace(assumed, bias=BIAS_SHARE * assumed.scale)
        return models_of(assumed, states, FAULTS)

    def _fix(
        self, batch: Batch, prior: Array, shifts: Shifts, told: tuple[Array, Array]
    ) -> Fix:
        """Return what the readings alone say."""
        mean, covariance = told
        numbers: dict[str, float] = {}
        n = 4 if batch.attitude is None else BATCH_STATES
        if self.checked:
            more = excess(shifts)
            gain = np.linalg.solve(prior[:2, :2], prior[:2]).T
            covariance = covariance + gain @ more @ gain.T
            numbers["widened"] = math.sqrt(np.trace(more) / np.trace(shifts.moments[1]))
        information = likelihood_information(mean[:n], covariance[:n, :n], prior[:n, :n])
        if not information.matrix.any():
            return declined(
                batch, "the batch tells nothing that the navigator does not know", **numbers
            )
        place, spread = measurement_only(mean[:4], covariance[:4, :4], prior[:4, :4])
        north, east = metres_per_radian(batch.end[0])
        return Fix(
            time=float(batch.time[-1]),
            latitude=float(batch.end[0] - place[0] / north),
            longitude=float(batch.end[1] - place[1] / east),
            covariance=spread,
            diagnostics=numbers,
            information=information,
        )

    def _after(self, memory: Memory, fields: Sequence[Beside], shifts: Shifts) -> Memory:
        learnt = list(memory.log_prior)
        for k, one in enumerate(fields):
            log_prior = shifts.seen[k].models.log_prior
            mixed = (1.0 - REMEMBERED) * np.exp(log_prior - np.logaddexp.reduce(log_prior))
            mixed[shifts.which[k]] += REMEMBERED * shifts.of_models(k)
            learnt[one.field] = np.log(mixed)
        return Memory(tuple(learnt), shifts)


def both_shapes(models: Models) -> Models:
    """Return the models twice: with errors as the map says, and with those that go with its
    gradient, which have the second half of the loads (`places.Seen.placed`)."""
    count = len(models.sigma)
    twice = Models(*(np.concatenate([column, column]) for column in models))
    shape = np.r_[models.shape, models.shape + len(models.lengths)]
    exact = np.r_[np.zeros(count, bool), models.sigma == 0.0]
    log_prior = np.where(exact, -1e3, twice.log_prior)
    return twice._replace(shape=shape, log_prior=log_prior - np.logaddexp.reduce(log_prior))


def where_possible(batch: Batch, field_map: FieldMap) -> Batch:
    """Return a batch without readings that hardly any place possible by the prior has on the
    map."""
    factor = np.linalg.cholesky(batch.prior[:2, :2])
    shifts = standard_normal(256, 2) @ factor.T
    north, east = metres_per_radian(batch.latitude)
    covered = field_map.covers(
        batch.latitude - shifts[:, :1] / north, batch.longitude - shifts[:, 1:] / east
    )
    possible = covered.mean(axis=0) > LEAST_ON_MAP
    return replace(batch, reading=np.where(possible, batch.reading, np.nan))


def without_outliers(seen: Sequence[Seen], prior: Array) -> Shifts:
    """Return the posterior without readings that do not fit the others at the likeliest shift."""
    seen = list(seen)
    for _ in range(ROUNDS):
        shifts, found = shifts_of(seen, prior), False
        for k, one in enumerate(seen):
            bad = outliers(shifts, k)
            rows = one.rows
            usual = float(np.median(rows.noise))
            left = bad | (rows.noise > 1e9 * usual)
            if bad.any() and left.sum() <= MOST_OUTLIERS * len(bad):
                noise = np.where(bad, 1e12 * usual, rows.noise)
                seen[k], found = replace(one, rows=rows._replace(noise=noise)), True
        if not found:
            return shifts
    return shifts_of(seen, prior)


def outliers(shifts: Shifts, field: int) -> Array:
    """Return (n,) which readings do not fit the others: residuals e of each predicted from the
    others, with e_i = (R⁻¹ r)_i / (R⁻¹)_ii and variance 1 / (R⁻¹)_ii (Rasmussen & Williams 2006,
    eq. 5.12)."""
    residual, R = best(shifts, field)
    precision = np.linalg.inv(R)
    return np.abs(precision @ residual) > OUTLIER_SIGMA * np.sqrt(np.diag(precision))


def best(shifts: Shifts, field: int) -> tuple[Array, Array]:
    """Return (n,) residuals at the likeliest shift, and (n, n) R of the likeliest model."""
    seen = shifts.seen[field]
    likely = int(shifts.which[field][int(np.argmax(shifts.of_models(field)))])
    place = shifts.centres[[int(np.argmax(shifts.log_density))]]
    return seen.residuals(place)[:, 0], seen.covariance(likely, shifts.size)


def posterior(shifts: Shifts, prior: Array) -> tuple[Array, Array]:
    """Return mean (7,) and covariance (7, 7) of the navigator's error by the bank."""
    them: Hypotheses | None = None
    for field, seen in enumerate(shifts.seen):
        which, centres, cell = pairs(shifts, field)
        them = at_cells(seen.models, centres, which, cell, prior)
        them = them.split(seen.field_map.grid, seen.rows).observed(seen.field_map.grid, seen.rows)
    assert them is not None
    return them.moments()


def pairs(shifts: Shifts, field: int) -> tuple[Array, Array, float]:
    """Return models (K,), cells (K, 2) and their size, m: which of them become hypotheses."""
    assert shifts.overview is not None
    size = shifts.size
    while size * 3.0 <= shifts.overview.size * 1.01:
        size *= 3.0
    cells, parent = np.unique(
        np.rint(shifts.centres / size).astype(int), axis=0, return_inverse=True
    )
    log = np.full((len(shifts.which[field]), len(cells)), -np.inf)
    own = shifts.by_model(field)
    own = own + shifts.log_density - np.logaddexp.reduce(own)
    for k, one in enumerate(own):
        np.logaddexp.at(log[k], parent.ravel(), one)
    order = np.argsort(-log, axis=None)[:PAIRS]
    order = order[log.ravel()[order] > log.max() - PAIR_DEPTH]
    model, cell = np.unravel_index(order, log.shape)
    return shifts.which[field][model], cells[cell] * size, size
