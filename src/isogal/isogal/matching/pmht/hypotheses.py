"""The bank: a Gaussian sum over models and places.

docs/mathematics.md, section 6. Alspach & Sorenson (1972, IEEE TAC 17:439) for Gaussian sums,
Magill (1965, IEEE TAC 10:434) and Maybeck & Hanlon (1995, IEEE TAES 31:1216) for the models.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.inertial.error_state import BATCH_STATES, HEADING
from isogal.maps.channels import AnyMap
from isogal.matching.information import LARGEST_RATIO, positive_part
from isogal.matching.interfaces import Information
from isogal.matching.pmht import kernels
from isogal.matching.pmht.models import CURVED, DECEIVED, FAMILIES, NONE, Models, largest
from isogal.matching.pmht.rows import Rows
from isogal.matching.pmht.states import UNKNOWN, States
from isogal.passage import Passage

REACH = 2.0
"""1-sigma at which it is looked at how far the map departs from linear (`CURVED`)."""
SPLIT = (
    (0.2129622780, 0.5740754440, 0.2129622780),
    (-1.1353227127, 0.0, 1.1353227127),
    0.6715662887,
)
"""Weights, means and 1-sigma of three Gaussians for one: the 1-sigma of DeMars, Bishop & Jah
(2013, JGCD 36:1047, table 1), weights and means those that are nearest in mean square with a
variance of 1; theirs loses 4.5 % of it at each split."""
MOST, USUAL_STATES = 3500, BATCH_STATES + 2 + len(UNKNOWN)
"""Hypotheses at most, of so many states, and fewer of more: bounds the time of a fix."""
NEGLIGIBLE = 10.0
"""Log of how much less probable a model is than the best of its neighbours to be left out."""
LIGHT = NEGLIGIBLE / 2.0
"""The same where all neighbours are less probable than the best model by this log."""
UNEXPLAINED_SHARE = 0.5
"""Of the largest sigma of the map's error, from which on the map is said to explain nothing."""
FLOOR = NEGLIGIBLE + LIGHT
"""A place that is less probable than all together by this log is not split, and is dropped unless
it is the best of its model. The best model of a group (`Models.group`) falls no further below the
best of all: what was wrong for hours may become right."""
CREDIBLE = 2.0
"""A fault is published where readings have made it so many times as probable as it was: a wide
model of a few percent would widen what is published for ever."""


UNSURE = 0.1
"""rad, 1-sigma of a heading above which a hypothesis is split: the path it has gone is then longer
by 0.5 % than the middle one's."""

COLUMNS = ("which", "log_weight", "mean", "covariance")
"""Arrays of `Hypotheses`, one row of each for each of them."""


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """K hypotheses: which model, and a Gaussian of the augmented state (see `kernels`)."""

    models: Models
    which: Integers
    """(K,)."""
    log_weight: Array
    """(K,)."""
    mean: Array
    """(K, N)."""
    covariance: Array
    """(K, N, N)."""

    @classmethod
    def of(
        cls, models: Models, which: Integers, log_weight: Array, mean: Array, covariance: Array
    ) -> "Hypotheses":
        """Return those with means (K, 7) and covariances (K, 7, 7) of the navigator's error,
        before any reading has said anything of the rest."""
        n, rest = BATCH_STATES, models.initial.shape[1]
        means, covariances = np.zeros((len(which), n + rest)), np.zeros((n + rest, n + rest))
        covariances = np.tile(covariances, (len(which), 1, 1))
        means[:, :n], covariances[:, :n, :n] = mean, covariance
        diagonal = np.arange(n, n + rest)
        covariances[:, diagonal, diagonal] = models.initial[which] ** 2
        return cls(models, which, log_weight, means, covariances)

    @classmethod
    def before(cls, models: Models, prior: Array) -> "Hypotheses":
        """Return those of a navigator of covariance (7, 7), one for each model, before any
        reading."""
        count, covariance = len(models.start), models.start[:, None, None] * prior
        nothing = np.zeros((count, BATCH_STATES))
        return cls.of(models, np.arange(count), models.log_prior.copy(), nothing, covariance)

    def __len__(self) -> int:
        return len(self.which)

    def part(self, which: Integers | Booleans) -> "Hypotheses":
        """Return some of them, by indices or a mask."""
        return Hypotheses(self.models, *(getattr(self, name)[which] for name in COLUMNS))

    def correlated(self, moving: Integers, covariance: Array) -> "Hypotheses":
        """Return them with a covariance (n, n) of the navigator's states, `moving` (n,), before
        any reading has said anything."""
        every = self.covariance.copy()
        every[:, moving[:, None], moving] = self.models.start[self.which, None, None] * covariance
        return replace(self, covariance=every)

    def passed(self, passage: Passage, moving: Integers) -> "Hypotheses":
        """Return them at the end of a passage, of the states `moving` (n,). Of a navigator that
        becomes uncertain faster than it says, what it has been told is as much less certain."""
        told, faster = passage.told, self.models.growth[self.which]
        them = self.informed(told, passage.before, moving, faster).headed()
        forward, growth = passage.transition
        mean, covariance = them.mean.copy(), them.covariance.copy()
        mean[:, moving] -= passage.mean
        faster = them.models.growth[them.which]
        kernels.passed(mean, covariance, moving, forward, growth, faster, passage.velocity)
        return replace(them, mean=mean, covariance=covariance).normalised()

    def headed(self) -> "Hypotheses":
        """Split those whose heading is not known to where sines are linear in it."""

        def unsure(them: Hypotheses, asked: Booleans) -> tuple[Booleans, Array]:
            sigma = np.sqrt(them.covariance[:, HEADING, HEADING])
            along = them.covariance[:, :, HEADING] / np.maximum(sigma, UNSURE)[:, None]
            return asked & (sigma > UNSURE), along

        return self._divided(unsure, self.most)

    def carried(self, forward: Array, growth: Array) -> "Hypotheses":
        """Return them about an error that is `forward` (7, 7) times theirs, and to whose
        covariance `growth` (7, 7) has been added."""
        mean, covariance = self.mean.copy(), self.covariance.copy()
        them, faster = np.arange(BATCH_STATES), self.models.growth[self.which]
        kernels.passed(mean, covariance, them, forward, growth, faster, np.zeros(2))
        return replace(self, mean=mean, covariance=covariance)

    def split(
        self, field_map: AnyMap, rows: Rows, most: int | None = None, curved: float = CURVED
    ) -> "Hypotheses":
        """Split those over which the map is not nearly linear (`CURVED`), along the worst axis,
        into at most so many."""
        where = field_map.grid, field_map.sigma_grid, rows

        def curved_over(them: Hypotheses, asked: Booleans) -> tuple[Booleans, Array]:
            along = np.zeros_like(them.mean)
            each = them.models, them.which, them.mean, them.covariance
            return kernels.departures(*where, *each, asked, REACH, along) > curved, along

        return self._divided(curved_over, most or self.most)

    def _divided(
        self, too_wide: Callable[["Hypotheses", Booleans], tuple[Booleans, Array]], most: int
    ) -> "Hypotheses":
        """Return them with those in thirds, and thirds of thirds, that are too wide; the
        likeliest, where there would be more than so many.

        Parameters
        ----------
        too_wide : function
            Of K hypotheses, and a mask (K,) which of them it is asked of: returns another one, and
            1-sigma vectors (K, N) along which to divide them.
        most : int
        """
        whole, done, least = self, list[Hypotheses](), self.log_evidence - FLOOR
        while True:  # `most` ends it on a map that is rough everywhere
            cut, along = too_wide(whole, whole.log_weight > least)
            room = (most - sum(len(one) for one in done) - len(whole)) // 2
            if cut.sum() > room:
                order = np.argsort(-np.where(cut, whole.log_weight, -np.inf))[: max(room, 0)]
                kept = np.zeros(len(cut), bool)
                kept[order] = True
                cut &= kept
            if not cut.any():
                break
            done.append(whole.part(~cut))
            whole = whole.part(cut)._thirds(along[cut])
        return joined([*done, whole]) if done else whole

    def _thirds(self, u: Array) -> "Hypotheses":
        """Return three for each, along a 1-sigma vector (K, N)."""
        weights, means, sigma = SPLIT
        less = self.covariance - (1.0 - sigma**2) * u[:, :, None] * u[:, None, :]
        return joined(
            [
                replace(
                    self,
                    log_weight=self.log_weight + math.log(w),
                    mean=self.mean + c * u,
                    covariance=less,
                )
                for w, c in zip(weights, means, strict=True)
            ]
        )

    def observed(self, field_map: AnyMap, rows: Rows) -> "Hypotheses":
        """Take new readings; none that leaves the map is left."""
        mean, covariance, evidence = self.mean.copy(), self.covariance.copy(), np.empty(len(self))
        where = field_map.grid, field_map.sigma_grid, rows
        kernels.observed(*where, self.models, self.which, mean, covariance, evidence)
        result = replace(
            self, log_weight=self.log_weight + evidence, mean=mean, covariance=covariance
        )
        kept = np.isfinite(result.log_weight) & np.isfinite(mean).all(axis=1)
        return result if kept.all() else result.part(kept)

    @property
    def log_evidence(self) -> float:
        """The log of the sum of their weights: of readings that they have taken since it was 0."""
        return float(np.logaddexp.reduce(self.log_weight)) if len(self) else -math.inf

    def informed(
        self,
        information: Information,
        prior: Array,
        states: Integers | None = None,
        faster: Array | None = None,
    ) -> "Hypotheses":
        """Return them after what others' readings say of the navigator's error, or of some
        `states` (n,); to each divided by `faster` (K,).

        Where that is negative they become wider: what others have withdrawn would else be told
        again, as new, by those who still hold it. Of what a Gaussian cannot say of places as far
        away they take a share: no variance becomes more than `LARGEST_RATIO` times as large.
        `prior` (n, n): the navigator's covariance, for scale."""
        if not information.matrix.any():
            return self
        which = np.arange(BATCH_STATES) if states is None else states
        n = len(which)
        mean, across = self.mean[:, which], self.covariance[:, :, which]
        P = across[:, which]
        positive = positive_part(information, np.sqrt(np.diag(prior)))
        M, vector = information.matrix - positive.matrix, information.vector - positive.vector
        # the mean of -x' M x
        withdrawn = -np.einsum("ij,kij->k", M, P) - ((mean @ M) * mean).sum(axis=1)
        share = 1.0 / np.maximum(withdrawn / (1.0 - 1.0 / LARGEST_RATIO), 1.0)
        believed = np.ones(len(self)) if faster is None else 1.0 / faster
        M = believed[:, None, None] * (positive.matrix + share[:, None, None] * M)
        vector = believed[:, None] * (positive.vector + share[:, None] * vector)
        left = vector - np.einsum("kij,kj->ki", M, mean)
        inner = np.eye(n) + M @ P
        solved = np.linalg.solve(inner, np.concatenate([M, left[..., None]], axis=2))
        gain, right = solved[..., :n], solved[..., n]
        shift = np.einsum("kij,kj->ki", across, right)
        evidence = 0.5 * np.einsum("ki,ki->k", mean, vector + left)
        evidence += 0.5 * np.einsum("ki,ki->k", left, shift[:, which])
        evidence -= 0.5 * np.linalg.slogdet(inner)[1]
        return replace(
            self,
            log_weight=self.log_weight + evidence,
            mean=self.mean + shift,
            covariance=self.covariance - across @ gain @ across.swapaxes(1, 2),
        )

    def aided(self, passage: Passage, prior: Array) -> "Hypotheses":
        """Return them after what satellites have told the navigator, whose covariance is `prior`
        (7, 7) since then.

        How well each had foretold that counts as much as a reading does, but makes no model more
        probable, beside those of no fault, than it was before any reading, or than readings have
        made it: errors of satellites hold together over minutes, which hypotheses of faster
        growth follow, and would be credited with. To hypotheses of satellites that are wrong it
        says nothing, neither for nor against them."""
        if not passage.jump.any():
            return self
        moved = self.moved(-passage.jump)
        alone = self.models.family[self.which] == DECEIVED
        before, rest = moved.part(~alone), moved.part(alone)
        told = before.informed(passage.aided(prior), prior)
        odds = (self.models.odds(log) for log in (self.models.log_prior, before.of_models))
        beyond = self.models.odds(told.of_models)[told.which] - np.maximum(*odds)[told.which]
        told = replace(told, log_weight=told.log_weight - np.maximum(beyond, 0.0))
        told = replace(told, log_weight=told.log_weight - told.log_evidence + before.log_evidence)
        return joined([told, rest]).normalised()

    @property
    def most(self) -> int:
        """How many there may be."""
        return round(MOST * at_same_time(self.mean.shape[1]))

    def reduced(self, of_place: Array) -> "Hypotheses":
        """Merge places (`merged`), drop what is negligible, keep the best of each model."""
        them = self
        if len(them) > self.most:
            them = them.part(np.argsort(-them.log_weight)[: self.most])
        order = np.lexsort((-them.log_weight, them.which))
        which = them.which[order]
        kept = them.log_weight[order] > them.log_evidence - FLOOR
        kept[0], kept[1:] = True, kept[1:] | (which[1:] != which[:-1])
        them = them.merged(order[kept], of_place)
        best = largest(them.of_models, self.models.group)
        lift = np.maximum(best.max() - FLOOR - best, 0.0)
        return replace(them, log_weight=them.log_weight + lift[them.which]).normalised()

    def merged(self, which: Integers, of_place: Array) -> "Hypotheses":
        """Return some of them, by indices, with places of one model merged that are within one
        1-sigma of each other: means of where a reading was taken, which is (m, north and east)
        `of_place` (2, N) per unit of the states. What a delay moves it by is part of that.

        The indices put them in the order of their models, and within one of falling weight."""
        them = self.part(which)
        columns = them.log_weight, them.mean, them.covariance
        stay = kernels.merged(them.which, *columns, np.ascontiguousarray(of_place))
        return them if len(stay) == len(them) else them.part(stay)

    @cached_property
    def of_models(self) -> Array:
        """(M,) the log weights of models."""
        total = np.full(len(self.models.sigma), -np.inf)
        np.logaddexp.at(total, self.which, self.log_weight)
        return total

    def moved(self, by: Array) -> "Hypotheses":
        """Return them relative to a navigator that has taken an error (7,) off its estimate."""
        mean = self.mean.copy()
        mean[:, :BATCH_STATES] -= by
        return replace(self, mean=mean)

    def normalised(self) -> "Hypotheses":
        """Return them with weights whose sum is 1."""
        return replace(self, log_weight=self.log_weight - np.logaddexp.reduce(self.log_weight))

    def credible(self) -> "Hypotheses":
        """Return them without faults that are not likely."""
        models = self.models
        before = np.bincount(models.family, np.exp(models.log_prior), len(FAMILIES))
        kept = self.faults > CREDIBLE * before
        kept[NONE] = True
        kept = kept[models.family[self.which]]
        return self if kept.all() else self.part(kept)

    def moments(self) -> tuple[Array, Array]:
        """Return mean (7,) and covariance (7, 7) of the navigator's error."""
        n = BATCH_STATES
        weight = self.weight
        mean = weight @ self.mean[:, :n]
        apart = self.mean[:, :n] - mean
        inner = (weight @ self.covariance[:, :n, :n].reshape(len(self), -1)).reshape(n, n)
        return mean, inner + (apart * weight[:, None]).T @ apart

    @cached_property
    def weight(self) -> Array:
        """(K,) probabilities."""
        return np.exp(self.log_weight - np.logaddexp.reduce(self.log_weight))

    @cached_property
    def map_error(self) -> tuple[float, float]:
        """Mean sigma (map's unit) and mean log length (m) of the map's error."""
        sigma, length = self.models.sigma[self.which], self.models.length[self.which]
        return float(self.weight @ sigma), math.exp(float(self.weight @ np.log(length)))

    @property
    def unexplained(self) -> float:
        """The probability that the map's error is among the largest that are thought of."""
        sigma = self.models.sigma
        large = (sigma > 0.0) & (sigma >= UNEXPLAINED_SHARE * sigma.max())
        return 0.0 if large.all() else float(self.weight @ large[self.which])

    @cached_property
    def faults(self) -> Array:
        """(F,) the probability of each of `models.FAMILIES`."""
        shares = np.bincount(self.models.family[self.which], self.weight, len(FAMILIES))
        return np.asarray(shares, dtype=np.float64)

    def figures(self, states: States) -> dict[str, float]:
        """Return the mean of the instrument's states that have names; of two of one name that of
        the first, which is specified."""
        mean = self.weight @ self.mean[:, BATCH_STATES + states.channels :]
        each = reversed(list(zip(states.names, mean, strict=True)))
        return {name: float(value) for name, value in each if name}


def at_same_time(states: int) -> float:
    """Return what share of hypotheses of the usual number of states takes about as long."""
    return min(1.0, USUAL_STATES / states)


def joined(parts: Sequence[Hypotheses]) -> Hypotheses:
    """Return the hypotheses of several parts."""
    columns = (np.concatenate([getattr(one, name) for one in parts]) for name in COLUMNS)
    return Hypotheses(parts[0].models, *columns)


def with_needed(bank: Hypotheses, errors: int) -> Hypotheses:
    """Return a bank with the models that are needed, and without others (a moving bank; Maybeck &
    Hentz 1987, JGCD 10:90); of hypotheses whose first states beside the navigator's are so many
    map errors.

    Models that differ by the sigma of the map's error only are neighbours. One that is negligible
    beside the best of them, in a group that is improbable already where it is less probable by
    `LIGHT`, is left out where no neighbour needs it, and begins with what that knows where one
    does. A negligible neighbour of a smaller sigma begins anew after each reading:
    it has followed too narrow a place, and were never probable again with that one. One of a
    larger sigma keeps its places, which are wider. Where both a noise and the next smaller one are
    improbable by `LIGHT`, no model of it is needed (docs/mathematics.md, section 6.4)."""
    models, total = bank.models, bank.of_models
    best = largest(total, models.group)
    likely = best > total.max() - LIGHT
    near = total > best - np.where(likely, NEGLIGIBLE, LIGHT)
    near &= likely | (models.quieter < 0) | likely[models.quieter]
    alike, there = models.group[1:] == models.group[:-1], np.isfinite(total)
    larger, smaller = np.zeros((2, len(total)), bool)
    larger[1:] = near[:-1] & alike & ~near[1:]
    smaller[:-1] = near[1:] & alike & ~near[:-1] & ~larger[:-1]
    kept = np.flatnonzero((near | larger & there)[bank.which])
    begins = larger & ~there, smaller, (models.quieter >= 0) & ~np.isfinite(best)
    begins[2][begins[2]] = (near & likely)[models.quieter[begins[2]]]
    new = np.full((3, len(total)), -1)  # the model that begins with what one knows, by three ways
    for k, which in enumerate(begins):
        each = np.flatnonzero(which)
        new[k, (each - 1, each + 1, models.quieter[each])[k]] = each
    way, those = np.nonzero(new[:, bank.which[kept]] >= 0)
    begun = new[way, bank.which[kept[those]]]
    bank = bank.part(np.append(kept, kept[those]))
    _begin(bank, begun, errors, there)
    return bank


def _begin(bank: Hypotheses, new: Integers, count: int, there: Booleans) -> None:
    """Make the last hypotheses those of the models `new` (K,), in place: the same map error is
    another number of 1-sigmas. Where that model is there, it is negligible, and begins as such."""
    last = slice(len(bank) - len(new), None)
    mean, covariance = bank.mean[last], bank.covariance[last]
    models, old = bank.models, bank.which[last].copy()
    sigma, prior = models.sigma, models.log_prior
    errors = slice(BATCH_STATES, BATCH_STATES + count)
    exact = sigma[new] == 0.0
    ratio = np.where(exact, 0.0, sigma[old] / np.where(exact, 1.0, sigma[new]))[:, None]
    mean[:, errors] *= ratio
    covariance[:, errors] *= ratio[..., None]
    covariance[:, :, errors] *= ratio[..., None]
    begun = (models.initial[old] == 0.0) * models.initial[new] ** 2
    diagonal = np.arange(BATCH_STATES, BATCH_STATES + begun.shape[1])
    covariance[:, diagonal, diagonal] += begun
    bank.log_weight[last] += prior[new] - prior[old] - np.where(there[new], NEGLIGIBLE, 0.0)
    bank.which[last] = new
