"""The bank of hypotheses on a recorded track: from a batch of readings to a fix.

No navigator says how wrong a track is, so that it may be anywhere within a prior of kilometres.
Where it may be is looked up on a grid of shifts first (`places`); cells and models that are not
impossible become hypotheses of the bank (`isogal.matching.pmht`), which take the readings as they
do on a vehicle. That a gridded map may be displaced widens the fix; of a map that
does not say over which lengths its errors hold together, how far the fix moves without half of the
readings (`widening`)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.maps.channels import AnyMap
from isogal.matching.information import (
    informed,
    likelihood_information,
    measurement_only,
    positive_part,
)
from isogal.matching.interfaces import Batch, Fix, Information, SecondaryBatch, declined, located
from isogal.matching.pmht.cells import at_cells
from isogal.matching.pmht.publish import added, total
from isogal.matching.pmht.rows import parts_of, some
from isogal.matching.pmht.states import BIAS, UNKNOWN
from isogal.matching.usability import too_few, unusable
from isogal.matrices import symmetric
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.evidence import Seen
from isogal.tracks.places import Shifts, shifts_of
from isogal.tracks.track import FEWEST
from isogal.tracks.widening import displacement, excess

CONFIDENCE = 0.9
"""Probability that the heaviest of several places needs; what the others have is in the
covariance."""
OFF_MAP = -1e5
OUTLIER_SIGMA, MOST_OUTLIERS = 6.0, 0.1
"""Beyond which a reading, predicted from all others, is left out; the share that may be."""
RIGID = 25.0
"""m, by which the velocity error (1-sigma) may bend a batch that counts as rigid."""
PAIRS, PAIR_DEPTH = 3000, 14.0
"""Cells with a model that become hypotheses, and log of how much less likely they may be."""


@dataclass(frozen=True)
class TrackMatcher:
    """Matches batches of recorded tracks, each by itself: what it hands on is the posterior of the
    last batch, for display."""

    settings: tuple[MatcherSettings, ...]
    """Of each field."""
    names: tuple[str, ...]
    """What the names of each field's figures begin with."""
    name: str = "pmht"
    context: int = 0
    takes_channels: bool = True

    def match(
        self, batch: Batch, field_map: AnyMap, memory: Shifts | None
    ) -> tuple[Fix, Shifts | None]:
        """Match one batch; see `interfaces.Matcher`."""
        if reason := unusable(batch):
            return declined(batch, reason), None
        seen = [
            found
            for one in (SecondaryBatch(0, batch, field_map), *batch.secondary)
            if (found := Seen.of(one, self.settings[one.field], self.names[one.field]))
        ]
        if not seen:
            count = int(np.isfinite(batch.reading[-batch.new :]).sum())
            reason = too_few(batch, min(count, FEWEST - 1), FEWEST)
            return declined(batch, reason or "no readings on the map"), None
        prior = batch.covariance
        shifts = without_outliers(seen, prior[:2, :2])
        if not shifts.log_density.max() > OFF_MAP:
            return declined(batch, "none of the likely places is on the map"), None
        places = shifts.places
        numbers = {"probability": float(places[0]), "places": float(len(places))}
        for one in shifts.seen:
            numbers |= {one.name + name: value for name, value in figures(shifts, one).items()}
        if places[0] < CONFIDENCE:
            reason = (
                f"ambiguous: {len(places)} places fit, the best with probability {places[0]:.2f};"
                " longer batches or a narrower prior may tell them apart"
            )
            return declined(batch, reason, **numbers), shifts
        if not any(shifts.tells_apart(one, prior[:2, :2]) for one in shifts.seen):
            reason = (
                "the map knows too little here: by its own 1-sigma, what it shows along the track"
                " cannot tell places apart"
            )
            return declined(batch, reason, **numbers), shifts
        return _fix(batch, prior, shifts, numbers), shifts


def _fix(batch: Batch, prior: Array, shifts: Shifts, numbers: dict[str, float]) -> Fix:
    """Return what the readings alone say."""
    bent = math.sqrt(prior[2, 2]) * (batch.time[-1] - batch.time[0])
    mean, covariance = (rigid if bent < RIGID else posterior)(shifts, prior)
    mean, covariance, prior = mean[:4], covariance[:4, :4], prior[:4, :4]
    information = likelihood_information(mean, covariance, prior)
    if not information.matrix.any():
        reason = "the batch tells nothing that the navigator does not know"
        return declined(batch, reason, **numbers)
    place, spread = measurement_only(mean, covariance, prior)
    more = displacement(shifts) + excess(shifts)
    if more.any():
        information = widened(information, more)
    known = {"diagnostics": numbers, "information": information}
    return located(batch, place, spread + more, **known)


def widened(information: Information, more: Array) -> Information:
    """Return information M, v with more covariance (2, 2) about the same place: (M⁻¹ + E)⁻¹ and
    (M⁻¹ + E)⁻¹ M⁻¹ v, where M may be singular. Directions without information stay without."""
    size = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(information.matrix)), 1e-300))
    positive = positive_part(information, size)
    spread = np.eye(4)
    spread[:, :2] += positive.matrix[:, :2] @ more
    both = np.linalg.solve(spread, np.column_stack([positive.matrix, positive.vector]))
    return Information(np.asarray(both[:, 4], np.float64), symmetric(both[:, :4]))


def without_outliers(seen: Sequence[Seen], prior: Array) -> Shifts:
    """Return the posterior without readings that do not fit the others at the likeliest shift."""
    shifts = shifts_of(seen, prior)
    out = [outliers(shifts, one) for one in shifts.seen]
    if any(bad.any() for bad in out):
        shifts = shifts_of([one.without(bad) for one, bad in zip(seen, out, strict=True)], prior)
    return shifts


def outliers(shifts: Shifts, one: Seen) -> Booleans:
    """Return (n,) which readings of a field do not fit the others: residuals e of each predicted
    from the others, with e_i = (R⁻¹ r)_i / (R⁻¹)_ii and variance 1 / (R⁻¹)_ii (Rasmussen &
    Williams 2006, eq. 5.12); none where these would be too many."""
    residual, R, _ = best(shifts, one)
    precision = np.linalg.inv(R)
    bad = np.abs(precision @ residual) > OUTLIER_SIGMA * np.sqrt(np.diag(precision))
    return np.asarray(bad & (bad.sum() <= MOST_OUTLIERS * len(bad)))


def best(shifts: Shifts, one: Seen) -> tuple[Array, Array, int]:
    """Return (n,) residuals of a field at the likeliest shift, (n, n) R of the likeliest model,
    and which it is."""
    likely = int(one.which[int(np.argmax(shifts.of_models(one)))])
    return one.residuals(shifts.likeliest)[:, 0], one.covariance(likely, shifts.size), likely


def figures(shifts: Shifts, one: Seen) -> dict[str, float]:
    """Return what a field's batch says of the errors of map and readings, lengths in m, the rest
    in the map's unit; and how many of its new readings were used, and how many left out as
    outliers or off the map."""
    weight = shifts.of_models(one)
    residual, R, likely = best(shifts, one)
    widest = 0.0
    if one.around is not None:  # of several channels there is no constant
        constant = one.models.initial[:, -len(UNKNOWN) + BIAS]
        R, widest = R - constant[likely] ** 2, float(constant[one.which].max())
    precision = np.linalg.inv(R)
    known = float(precision.sum()) + (1.0 / widest**2 if widest > 0.0 else math.inf)
    offset = float(precision.sum(axis=0) @ residual) / known
    left = residual - offset
    return {
        "map_sigma": float(weight @ one.map_sigma),
        "map_correlation_length": math.exp(float(weight @ np.log(one.length))),
        "offset": offset,
        "offset_sigma": 1.0 / math.sqrt(known),
        "misfit": float(left @ precision @ left) / len(left),
        "readings": float(len(one.readings.level) - one.old),
        "readings_left_out": float(one.unused),
    }


def rigid(shifts: Shifts, prior: Array) -> tuple[Array, Array]:
    """Return mean (7,) and covariance (7, 7) of the navigator's error where the shift says all."""
    place, spread = shifts.moments
    gain = np.linalg.solve(prior[:2, :2], prior[:2]).T
    return gain @ place, prior + gain @ (spread - prior[:2, :2]) @ gain.T


def posterior(shifts: Shifts, prior: Array) -> tuple[Array, Array]:
    """Return mean (7,) and covariance (7, 7) of the navigator's error by the bank, from the cells
    and models that all readings leave."""
    said = list[Information]()
    for seen in shifts.seen:
        which, centres, cell = pairs(shifts, seen)
        new = some(seen.readings, seen.old, len(seen.readings.level))
        them = at_cells(seen.models, centres, which, cell, prior).informed(total(said), prior)
        for part in parts_of(new):
            them = them.split(seen.field_map, part).observed(seen.field_map, part)
            if not len(them):
                return rigid(shifts, prior)
        said.append(added(them, prior, total(said)))
    return informed(prior, total(said))


def pairs(shifts: Shifts, one: Seen) -> tuple[Integers, Array, float]:
    """Return models (K,) of a field, cells (K, 2) and their size, m: which of them become
    hypotheses."""
    assert shifts.overview is not None
    size = shifts.size
    while size * 3.0 <= shifts.overview.size * 1.01:
        size *= 3.0
    cells, parent = np.unique(
        np.rint(shifts.centres / size).astype(int), axis=0, return_inverse=True
    )
    log, own = np.full((len(one.which), len(cells)), -np.inf), one.by_model
    for k, density in enumerate(own + shifts.log_density - np.logaddexp.reduce(own)):
        np.logaddexp.at(log[k], parent.ravel(), density)
    order = np.argsort(-log, axis=None)[:PAIRS]
    order = order[log.ravel()[order] > log.max() - PAIR_DEPTH]
    model, cell = np.unravel_index(order, log.shape)
    return one.which[model], cells[cell] * size, size
