"""The bank of hypotheses on a recorded track: from a batch of readings to a fix.

No navigator says how wrong a track is, so that it may be anywhere within a prior of kilometres.
Where it may be is looked up on a grid of shifts first (`places`); cells and models that are not
impossible become hypotheses of the bank (`isogal.matching.pmht`), which take the readings as they
do on a vehicle. That a gridded map may be displaced widens the fix; of a map that
does not say over which lengths its errors hold together, how far the fix moves without half of the
readings (`widening`)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.channels import AnyMap, RouteMap
from isogal.maps.field_map import FieldMap
from isogal.matching.information import (
    informed,
    likelihood_information,
    measurement_only,
    positive_part,
)
from isogal.matching.interfaces import Batch, Fix, Information, SecondaryBatch, declined, located
from isogal.matching.pmht.cells import at_cells
from isogal.matching.pmht.publish import added, total
from isogal.matching.pmht.rows import parts_of, rows_of, some
from isogal.matching.pmht.states import BIAS, UNKNOWN, States
from isogal.matching.quasi_random import standard_normal
from isogal.matching.usability import too_few, unusable
from isogal.matrices import symmetric
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.continued_map import continued
from isogal.tracks.evidence import Seen
from isogal.tracks.models import track_models
from isogal.tracks.places import Shifts, shifts_of
from isogal.tracks.track import FEWEST
from isogal.tracks.widening import displacement, excess

CONFIDENCE = 0.9
"""Probability that the heaviest of several places needs; what the others have is in the
covariance."""
OFF_MAP = -1e5
OUTLIER_SIGMA, MOST_OUTLIERS = 6.0, 0.1
"""Beyond which a reading, predicted from all others, is left out; the share that may be."""
MAP_REACH, POSSIBLE, SURE = 4.0, 0.05, 0.95
"""Prior 1-sigmas by which a map is continued, and share of the places possible by the prior that
must lie on the map for a reading to be used: of a map that is continued, of one that is not."""
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
    name: str = "pmht"
    context: int = 0
    takes_channels: bool = True

    def match(
        self, batch: Batch, field_map: AnyMap, memory: Shifts | None
    ) -> tuple[Fix, Shifts | None]:
        """Match one batch; see `interfaces.Matcher`."""
        if reason := unusable(batch):
            return declined(batch, reason), None
        each = (SecondaryBatch(0, batch, field_map), *batch.secondary)
        found = [
            (one.field, seen)
            for one in each
            if (seen := seen_of(one.batch, one.field_map, self.settings[one.field]))
        ]
        if not found:
            count = int(np.isfinite(batch.reading[-batch.new :]).sum())
            reason = too_few(batch, min(count, FEWEST - 1), FEWEST)
            return declined(batch, reason or "no readings on the map"), None
        prior = batch.covariance
        fields = tuple(field for field, _ in found)
        shifts, left = without_outliers([seen for _, seen in found], prior[:2, :2])
        if not shifts.log_density.max() > OFF_MAP:
            return declined(batch, "none of the likely places is on the map"), None
        places = shifts.places
        numbers = {"probability": float(places[0]), "places": float(len(places))}
        given = {0: batch} | {one.field: one.batch for one in batch.secondary}
        for k, field in enumerate(fields):
            prefix = f"{self.names[field]}." if field else ""
            of_field = figures(shifts, k, given[field], left[k])
            numbers |= {prefix + name: value for name, value in of_field.items()}
        if places[0] < CONFIDENCE:
            reason = (
                f"ambiguous: {len(places)} places fit, the best with probability {places[0]:.2f};"
                " longer batches or a narrower prior may tell them apart"
            )
            return declined(batch, reason, **numbers), shifts
        if not any(shifts.tells_apart(k, prior[:2, :2]) for k in range(len(fields))):
            reason = (
                "the map knows too little here: by its own 1-sigma, what it shows along the track"
                " cannot tell places apart"
            )
            return declined(batch, reason, **numbers), shifts
        return _fix(batch, prior, shifts, numbers), shifts


def seen_of(batch: Batch, field_map: AnyMap, settings: MatcherSettings) -> Seen | None:
    """Return a batch's readings of one field with the models that are possible by a scenario's
    matcher section; None where too few lie on the map."""
    around = None
    if isinstance(field_map, FieldMap):
        reach = MAP_REACH * math.sqrt(float(np.diag(batch.prior)[:2].max()))
        # models of a track have noise and a constant of the readings besides
        field_map = field_map.resolved
        around = continued(field_map, reach)
    batch = on_map(batch, field_map, SURE if around is None else POSSIBLE)
    states = States.of(batch, field_map)
    models = track_models(settings, batch, field_map, states)
    # what earlier batches have used counts as given
    old = int(np.isfinite(batch.reading[: len(batch) - batch.new]).sum())
    whole = replace(batch, new=len(batch))
    rows, _ = rows_of(whole, field_map, states, models.lengths, None)
    if rows is None or len(rows.level) - old < FEWEST:
        return None
    field_map = field_map if around is None else around.field
    potential = None if batch.layout is None else batch.layout.of_one_potential
    return Seen.of(rows, field_map, around, models, potential, old)


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


def on_map(batch: Batch, field_map: RouteMap, least: float) -> Batch:
    """Return a batch without readings that less than a share of the places possible by the prior
    has on the map, unless these are more than half of those that are on it as recorded: of these,
    then, it has all.

    A matcher that takes a place off the map as impossible needs a share of `SURE`: a reading
    whose true place may lie off the map would push the fix away from there. One that continues
    the map needs `POSSIBLE`."""
    shifts = standard_normal(256, 2) @ np.linalg.cholesky(batch.prior[:2, :2]).T
    north, east = metres_per_radian(batch.latitude)
    covered = field_map.covers(
        batch.latitude - shifts[:, :1] / north, batch.longitude - shifts[:, 1:] / east
    )
    there, new = np.isfinite(batch.reading), np.arange(len(batch)) >= len(batch) - batch.new
    recorded = there & field_map.covers(batch.latitude, batch.longitude)
    kept = there & (covered.mean(axis=0) > least)
    if (kept & new).sum() < 0.5 * (recorded & new).sum():
        kept = recorded
    return replace(batch, reading=np.where(kept, batch.reading, np.nan))


def without_outliers(seen: Sequence[Seen], prior: Array) -> tuple[Shifts, list[int]]:
    """Return the posterior without readings that do not fit the others at the likeliest shift, and
    how many of each field these are."""
    shifts = shifts_of(seen, prior)
    out = [outliers(shifts, field) for field in range(len(seen))]
    if any(bad.any() for bad in out):
        shifts = shifts_of([one.without(bad) for one, bad in zip(seen, out, strict=True)], prior)
    return shifts, [int(one.rows.sizes[bad].sum()) for one, bad in zip(seen, out, strict=True)]


def outliers(shifts: Shifts, field: int) -> Booleans:
    """Return (n,) which readings do not fit the others: residuals e of each predicted from the
    others, with e_i = (R⁻¹ r)_i / (R⁻¹)_ii and variance 1 / (R⁻¹)_ii (Rasmussen & Williams 2006,
    eq. 5.12); none where these would be too many."""
    residual, R, _ = best(shifts, field)
    precision = np.linalg.inv(R)
    bad = np.abs(precision @ residual) > OUTLIER_SIGMA * np.sqrt(np.diag(precision))
    return np.asarray(bad & (bad.sum() <= MOST_OUTLIERS * len(bad)))


def best(shifts: Shifts, field: int) -> tuple[Array, Array, int]:
    """Return (n,) residuals at the likeliest shift, (n, n) R of the likeliest model, and which it
    is."""
    seen = shifts.seen[field]
    likely = int(shifts.which[field][int(np.argmax(shifts.of_models(field)))])
    return seen.residuals(shifts.likeliest)[:, 0], seen.covariance(likely, shifts.size), likely


def figures(shifts: Shifts, field: int, batch: Batch, left_out: int) -> dict[str, float]:
    """Return what a field's batch says of the errors of map and readings, lengths in m, the rest
    in the map's unit; and how many of its new readings were used, and how many left out as
    outliers or off the map."""
    seen, which = shifts.seen[field], shifts.which[field]
    models, weight = seen.models, shifts.of_models(field)
    residual, R, likely = best(shifts, field)
    widest = 0.0
    if seen.around is not None:  # of several channels there is no constant
        constant = models.initial[:, -len(UNKNOWN) + BIAS]
        R, widest = R - constant[likely] ** 2, float(constant[which].max())
    precision = np.linalg.inv(R)
    known = float(precision.sum()) + (1.0 / widest**2 if widest > 0.0 else math.inf)
    offset = float(precision.sum(axis=0) @ residual) / known
    left = residual - offset
    new = np.isfinite(batch.reading[-batch.new :]).sum()
    used = len(seen.readings.level) - seen.old
    return {
        "map_sigma": float(weight @ seen.map_sigma(which)),
        "map_correlation_length": math.exp(float(weight @ np.log(models.length[which]))),
        "offset": offset,
        "offset_sigma": 1.0 / math.sqrt(known),
        "misfit": float(left @ precision @ left) / len(left),
        "readings": float(used),
        "readings_left_out": float(left_out + new - used),
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
    for field, seen in enumerate(shifts.seen):
        which, centres, cell = pairs(shifts, field)
        new = some(seen.readings, seen.old, len(seen.readings.level))
        them = at_cells(seen.models, centres, which, cell, prior).informed(total(said), prior)
        for part in parts_of(new):
            them = them.split(seen.field_map, part).observed(seen.field_map, part)
            if not len(them):
                return rigid(shifts, prior)
        said.append(added(them, prior, total(said)))
    return informed(prior, total(said))


def pairs(shifts: Shifts, field: int) -> tuple[Integers, Array, float]:
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
