"""What may be true of map, instrument and navigator: the models of the bank and their priors.

A model is one value of everything that has no place in a Gaussian state: how wrong the map is and
over which length, how noisy the instrument, whether it has a bias, and whether the navigator is
worse than it says. One thing beside the map is wrong at a time. docs/mathematics.md, section 8.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array, Integers
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.quantities import GRAVITY
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.states import (
    BIAS,
    COUPLING_FORWARD,
    COUPLING_RIGHT,
    DELAY,
    DRIFT,
    FILTER,
    FILTER_ERROR,
    UNKNOWN,
    States,
)
from isogal.matching.registry import check_options
from isogal.scenario import Matcher as MatcherSettings

CURVED = 0.25
"""Share of its change by which the map may depart from linear over a hypothesis before that is
split, unless an option says otherwise."""
LENGTH_STEP, LENGTH_FACTOR = 4.0, 2.5
LEAST_SIGMA, OF_SCALE = 0.125, 0.5
"""Of the map's error: least sigma in units of the noise, largest in units of the map's scale; the
1-sigma of a bias is as large."""
SIGMA_STEP = math.sqrt(2.0)
"""From one sigma of the map's error to the next. With steps twice as long, a sigma between two of
them costs a fault so much evidence that a delay of 20 s is not found."""
NARROW = 0.4
"""Sigma, in units of the noise, below which readings do not distinguish lengths."""
ROUGH_FACTOR = 5.0
"""Factor (1-sigma) by which a map may be more wrong than it is rough."""
NO_ERROR = 4.0
"""How much more probable it is that the map has no error than one of the least sigma: it stands
for all sigmas below."""
DRIFT_TIME = 10800.0
"""1-sigma of a drift: that of the bias in so many s."""
RARE, UNHEARD_OF = 0.01, 1e-3
"""Probability of a fault that one has heard of, and of one that one has not: a specified map error
that is wrong altogether, a navigator that has diverged."""
WORSE = 10.0
"""Factor of a navigator's covariance from one model to the next."""
LAGS, UNSURE_LAG = (15.0, 60.0), 0.5
"""Time constants of a low-pass filter, s, and their 1-sigma, of themselves."""
FINER_LAGS = (10.0, 20.0, 40.0, 80.0)
"""Those where a place is searched for, with half the 1-sigma: cells are ranked by time constants
as they are, and with the two above one of 40 s was found in no cell."""
DECADES = (10.0, 100.0, 1000.0)
"""Factors of the noise's variance beside a filter, and where a place is searched for."""
LATE_S = 20.0
"""1-sigma of a delay where none is specified."""
COUPLING = 1e-3
"""1-sigma of what a gravimeter takes from each horizontal acceleration: 1 mGal from 0.01 m/s²."""

COARSE_SHARES, COARSE_LENGTH = (0.5, 1.0), 0.5
"""1-sigma of what a map's grid leaves out, as shares of its roughness (over SE Australia, half as
dense: 0.15 to 0.97 in 26 parts of the track, 0.55 in the mean), and its correlation length in
steps of the grid (0.4 there): it is 0 at the nodes."""

FAMILIES = (
    "none", "biased", "noisier", "navigator", "late", "filtered", "shaken", "coarse", "deceived",
)  # fmt: skip
NONE, BIASED, NOISIER, NAVIGATOR, LATE, FILTERED, SHAKEN, COARSE, DECEIVED = range(9)
OF_ONE_NUMBER = {BIASED, LATE, FILTERED, SHAKEN}
"""Of instruments whose reading is one number."""


class Fault(NamedTuple):
    """What is wrong beside the map."""

    family: int
    probability: float
    noise: float = 1.0
    """Factor of the noise's variance."""
    bias: float = 0.0
    """1-sigma, in units of that of a bias that is not specified."""
    drift: float = 0.0
    delay: float = 0.0
    """1-sigma, s."""
    lag: float = 0.0
    """Time constant of a low-pass filter, s."""
    coupling: float = 0.0
    """1-sigma, reading's unit per m/s²."""
    start: float = 1.0
    """Factor of the navigator's covariance at the start."""
    growth: float = 1.0
    """Factor of all that it grows by."""


FAULTS = (
    Fault(NONE, 0.7),
    Fault(BIASED, 0.1, bias=1.0),
    Fault(BIASED, 0.1, bias=1.0, drift=1.0),
    Fault(NOISIER, 0.05, noise=3.0),
    Fault(NOISIER, 0.02, noise=10.0),
    # half a decade apart as the others, up to a 1-sigma thirty times as large
    *(Fault(NOISIER, RARE, noise=factor) for factor in (30.0, 100.0, 300.0, 1000.0)),
    # a wrong start and late readings are one error on a straight track: where a delay is the more
    # probable one, starts that are three times worse are taken for delays
    Fault(NAVIGATOR, 0.05, start=WORSE),
    Fault(NAVIGATOR, RARE, start=WORSE, growth=WORSE),
    Fault(NAVIGATOR, RARE, growth=WORSE),
    Fault(NAVIGATOR, RARE, growth=WORSE**2),
    Fault(LATE, 0.02, delay=LATE_S),
    *(Fault(FILTERED, 0.02, lag=lag) for lag in LAGS),
    *(Fault(FILTERED, UNHEARD_OF, lag=lag, delay=LATE_S) for lag in LAGS),
    *(Fault(FILTERED, 0.02 * RARE, factor, lag=lag) for lag in LAGS for factor in DECADES),
    Fault(SHAKEN, RARE, coupling=COUPLING),
    Fault(COARSE, 0.05),
    # satellites are wrong on a voyage in a thousand, times how likely what they say is then: as
    # likely anywhere within a kilometre as within metres where they are right
    Fault(DECEIVED, UNHEARD_OF**2),
)


class Models(NamedTuple):
    """M models, as compiled loops take them."""

    sigma: Array
    """(M,) of the map's error, map's unit."""
    length: Array
    """(M,) m."""
    shape: Integers
    """(M,) which of `shapes`."""
    rough: Array
    """(M,) roughness of the map where its error has this sigma, map's unit: it is in proportion to
    that; 0 = it is the same everywhere."""
    noise: Array
    """(M,)."""
    lag: Array
    """(M,) s."""
    start: Array
    """(M,)."""
    growth: Array
    """(M,)."""
    tails: Array
    """(M,) degrees of freedom of the innovations' density; infinite = Gaussian."""
    initial: Array
    """(M, N - 7) 1-sigma of map errors (1 or 0) and instrument states before any reading."""
    used: Integers
    """(M, N) the states that a model has come first."""
    sizes: Integers
    """(M,) how many they are."""
    family: Integers
    """(M,)."""
    group: Integers
    """(M,) rising; models of one differ by the sigma of the map's error, which rises."""
    quieter: Integers
    """(M,) the model of the next smaller noise, or of the same and no filter; -1 = none."""
    log_prior: Array
    """(M,)."""

    def odds(self, log_weight: Array) -> Array:
        """Return log weights (M,) beside that of all models without a fault; as they are where
        there is none of these."""
        plain = np.logaddexp.reduce(log_weight[self.family == NONE])
        return log_weight - plain if np.isfinite(plain) else log_weight

    @property
    def lengths(self) -> Array:
        """(L,) correlation lengths of the map's error, m."""
        return np.unique(self.length)

    @property
    def shapes(self) -> tuple[Array, Array]:
        """(S,) correlation lengths of the map's error (m) and `rough`, as `shape` counts them."""
        first = np.unique(self.shape, return_index=True)[1]
        return self.length[first], self.rough[first]


def largest(log_weight: Array, which: Integers) -> Array:
    """Return for each log weight (K,) the largest one of those that `which` (K,) puts together."""
    best = np.full(int(which.max()) + 1, -np.inf)
    np.maximum.at(best, which, log_weight)
    return best[which]


@dataclass(frozen=True, slots=True)
class Assumed:
    """What is known of map and instrument before any reading. Map's unit, m, s."""

    noise: float
    """1-sigma of the white noise."""
    scale: float
    """Standard deviation of the map."""
    rough: float
    """Its roughness."""
    step: float = 4000.0
    """From one node of its grid to the next, m."""
    sigma: float | None = None
    """1-sigma of the map's error as specified; None = it is not."""
    length: float = 4000.0
    trust: float = 2.0
    """Factor within which these two are right where specified (1-sigma); 1 = to the letter."""
    bias: float = 0.0
    """1-sigma of a specified bias."""
    drift: float = 0.0
    """1-sigma, per s."""
    delay: float = 0.0
    """1-sigma of a specified delay, s."""
    lag: float = 0.0
    """Time constant of a specified low-pass filter, s."""
    tails: float = math.inf
    """Degrees of freedom of the density of a reading's error."""
    without: frozenset[int] = frozenset({DECEIVED})
    """Families of faults that there cannot be, or that are specified instead."""


class Options(BaseModel):
    """`matcher.options` of a scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    trust: float = Field(
        2.0,
        ge=1.0,
        le=100.0,
        description=(
            "factor within which a given map_sigma and correlation length are right (1-sigma); 1"
            " = to the letter"
        ),
    )
    curved: float = Field(
        CURVED,
        gt=0.0,
        le=1.0,
        description=(
            "share of its change by which the map may depart from linear over a hypothesis before"
            " that is split; less where a navigator is far less certain than the map's hills are"
            " wide, at the price of time"
        ),
    )
    tails: float | None = Field(
        None,
        gt=2.0,
        le=100.0,
        description=(
            "degrees of freedom of Student's t density, which the difference of a reading and the"
            " map has: of errors that are now and then many times as large as usual, over several"
            " readings; null = Gaussian, with a few outliers"
        ),
    )
    bias_drift_sigma: float | None = Field(
        None,
        ge=0.0,
        description=(
            "1-sigma of the readings' drift, map's unit per second; null = bias_sigma in three"
            " hours"
        ),
    )


def options_of(matcher: MatcherSettings) -> Options:
    """Return its options; raises InputError on an unknown or bad one."""
    return check_options("pmht", matcher.options, Options)


def assumed(matcher: MatcherSettings, batch: Batch, field_map: AnyMap) -> Assumed:
    """Return what is known before the first batch of a run, by a scenario's matcher section;
    raises InputError on a bad option."""
    options, maps = options_of(matcher), channels_of(field_map)
    rounding = float(np.mean([one.quantisation for one in maps])) / math.sqrt(12.0)
    stated = float(np.mean([one.usual_sigma for one in maps]))
    specified = None if matcher.map_sigma == "auto" else float(matcher.map_sigma)
    if stated > 0.0:
        specified = max(specified or 0.0, stated)
    drift = options.bias_drift_sigma
    instrument = batch.instrument
    named = () if instrument.parameters is None else instrument.parameters.names
    known = (
        (BIASED, matcher.bias_sigma > 0.0 or instrument.bias_walk > 0.0),
        (LATE, instrument.delay_sigma > 0.0),
        (FILTERED, instrument.filter_time > 0.0 or batch.rows_per_scan > 1),
        (SHAKEN, field_map.quantity not in GRAVITY or "coupling_forward" in named),
        (DECEIVED, not batch.history.satellites),
    )
    return Assumed(
        noise=math.hypot(float(np.nanmedian(batch.sigma)), rounding),
        scale=float(np.mean([one.scale for one in maps])),
        rough=float(np.mean([one.roughness for one in maps])),
        step=math.hypot(*maps[0].cell_size_m(float(batch.latitude[-1]))) / math.sqrt(2.0),
        sigma=specified,
        length=matcher.map_correlation_length,
        trust=options.trust,
        bias=matcher.bias_sigma,
        drift=matcher.bias_sigma / DRIFT_TIME if drift is None else drift,
        delay=instrument.delay_sigma,
        lag=instrument.filter_time,
        tails=options.tails or math.inf,
        without=frozenset(family for family, gone in known if gone),
    )


def models_of(assumed: Assumed, states: States) -> Models:
    """Return the models of a run."""
    gone = assumed.without | (set() if states.unknown else OF_ONE_NUMBER)
    if assumed.sigma is not None or not assumed.rough > 0.0:
        gone |= {COARSE}
    faults = [fault for fault in FAULTS if fault.family not in gone]
    if assumed.sigma == 0.0 or assumed.trust == 1.0:
        faults = [fault for fault in faults if fault.family in (NONE, DECEIVED)]
    fine, usual = _map_errors(assumed, True), _map_errors(assumed, False)
    rows = []
    for fault in faults:
        errors = fine if fault.family == NONE else usual
        if fault.family == COARSE:
            length = COARSE_LENGTH * assumed.step
            errors = [(share * assumed.rough, length, 0.0) for share in COARSE_SHARES]
        total = np.logaddexp.reduce([e[2] for e in errors])
        rows += [
            (s, length, lp - total + math.log(fault.probability), fault)
            for s, length, lp in errors
        ]
    return table_of(rows, assumed, states)


def _map_errors(assumed: Assumed, lengths: bool) -> list[tuple[float, float, float]]:
    """Return sigmas, lengths and log weights of the map's error. Where nothing is specified every
    sigma is as likely as any other up to the map's roughness, larger ones less so; what is
    specified is right within a factor (1-sigma of a log-normal density), but for a small
    probability."""
    specified, usual, trust = assumed.sigma, assumed.length, assumed.trust
    if specified is not None and trust == 1.0:
        return [(specified, usual, 0.0)]
    least, most = LEAST_SIGMA * assumed.noise, OF_SCALE * assumed.scale
    if assumed.rough > 0.0:  # readings of much noise make no map worse
        least = min(least, assumed.rough)
    if specified:  # is one of the grid
        least = specified / SIGMA_STEP ** _steps(max(specified / least, trust**2))
        most = max(most, specified * trust**2)
    sigmas = least * SIGMA_STEP ** np.arange(_steps(max(most / least, 4.0)) + 1.0)
    choices = (usual / LENGTH_STEP, usual, usual * LENGTH_STEP) if lengths else (usual,)
    each = [
        (sigma, length)
        for sigma in sigmas
        for length in (choices if sigma > NARROW * assumed.noise else (usual,))
    ]
    sigma, length = np.array([(0.0, usual), *each]).T
    rough = min(max(assumed.rough, least), sigmas[-1])
    above = np.log(np.maximum(sigma / rough, 1.0)) / math.log(ROUGH_FACTOR)
    longer = np.log(length / usual)
    log = -0.5 * (above**2 + (longer / math.log(LENGTH_FACTOR)) ** 2)
    log[0] = math.log(NO_ERROR)
    if specified is not None:
        right = np.where(sigma == specified, 0.0, -np.inf)
        if specified > 0.0:
            off = np.log(sigma[1:] / specified)
            right[1:] = -0.5 * (off**2 + longer[1:] ** 2) / math.log(trust) ** 2
        otherwise = log - np.logaddexp.reduce(log) + math.log(UNHEARD_OF)
        log = np.logaddexp(right - np.logaddexp.reduce(right), otherwise)
    return list(zip(sigma.tolist(), length.tolist(), log.tolist(), strict=True))


def _steps(factor: float) -> int:
    """Return how many steps of the grid of sigmas a factor is."""
    return math.ceil(math.log(factor) / math.log(SIGMA_STEP) - 1e-9)


def table_of(
    rows: Sequence[tuple[float, float, float, Fault]], assumed: Assumed, states: States
) -> Models:
    """Return models of (sigma, length, log prior, fault)."""
    order = {fault: k for k, fault in enumerate(dict.fromkeys(row[3] for row in rows))}
    rows = sorted(rows, key=lambda row: (order[row[3]], row[1], row[0]))
    count = len(rows)
    initial = np.zeros((count, states.channels + len(states.sigma)))
    initial[:, states.channels :] = states.sigma
    sigma, length, log_prior = (np.array([row[k] for row in rows]) for k in range(3))
    fault = [row[3] for row in rows]
    initial[:, : states.channels] = (sigma > 0.0)[:, None]
    if states.smooth:
        initial[:, 1] = [f.family == COARSE for f in fault]
    if states.unknown:
        last = initial[:, -states.unknown :]
        share = OF_SCALE * assumed.scale
        last[:, BIAS] = [max(f.bias * share, assumed.bias) for f in fault]
        last[:, DRIFT] = [max(f.drift * share / DRIFT_TIME, assumed.drift) for f in fault]
        last[:, DELAY] = [max(f.delay, assumed.delay) for f in fault]
        last[:, FILTER_ERROR] = [UNSURE_LAG * f.lag for f in fault]
        last[:, FILTER] = [assumed.scale if f.lag or assumed.lag else 0.0 for f in fault]
        last[:, COUPLING_FORWARD] = last[:, COUPLING_RIGHT] = [f.coupling for f in fault]
    has = np.concatenate([np.ones((count, BATCH_STATES), bool), initial > 0.0], axis=1)
    has[:, BATCH_STATES + states.channels :] |= states.walk > 0.0
    family, noise, start, growth = (
        np.array([getattr(f, name) for f in fault])
        for name in ("family", "noise", "start", "growth")
    )
    lag = np.array([f.lag or assumed.lag for f in fault])
    begins = [a[3] != b[3] or a[1] != b[1] for a, b in itertools.pairwise(rows)]
    rough = np.where(family == COARSE, assumed.rough, 0.0)
    shape = np.unique(np.stack([rough, length], axis=1), axis=0, return_inverse=True)[1]
    noisier = {(r[3].noise, *r[:2]): k for k, r in enumerate(rows) if r[3].family == NOISIER}
    less = dict(itertools.pairwise(sorted({key[0] for key in noisier}, reverse=True)))
    quieter = [
        noisier.get((r[3].noise if r[3].lag else less.get(r[3].noise, 0.0), *r[:2]), -1)
        for r in rows
    ]
    return Models(
        sigma,
        length,
        shape.reshape(-1).astype(np.int64),
        rough,
        noise,
        lag,
        start,
        growth,
        np.full(count, assumed.tails),
        initial,
        np.argsort(~has, axis=1, kind="stable"),
        has.sum(axis=1),
        family,
        np.cumsum([False, *begins]),
        np.array(quieter),
        log_prior - np.logaddexp.reduce(log_prior),
    )


def few(models: Models, noise: float, most: float, biased: bool) -> Models:
    """Return the models by which a place is searched for: those without a fault but of the noise,
    whose variances are a decade apart and at most so many times what is specified, or of a filter,
    whose time constants are a factor of two apart, since cells are ranked by them as they are, or
    of a bias, if that is asked for; of the usual length, with no map error and with sigmas that
    are at least a factor of two apart, down to what readings of a 1-sigma can distinguish."""
    index = np.arange(float(len(models.sigma)))
    every_second = (largest(index, models.group) - index) % 2.0 == 0.0  # step of SIGMA_STEP
    shown = every_second & (models.sigma > NARROW * noise * np.sqrt(models.noise))
    wanted = np.isin(models.family, (NONE, NOISIER))
    one = (models.family == FILTERED) & (models.lag == LAGS[0])
    one |= biased & (models.family == BIASED)
    if one.any():  # without a delay or a drift beside it
        also = models.initial[:, [DRIFT - len(UNKNOWN), DELAY - len(UNKNOWN)]]
        wanted |= one & (also <= also[models.family == NONE].max(axis=0)).all(axis=1)
    wanted &= np.isin(models.noise, (1.0, *DECADES)) & (models.noise <= most)
    wanted &= (models.length == np.median(models.length)) & (shown | (models.sigma == 0.0))
    part = Models._make(column[wanted] for column in models)
    part = _with_lags(part, np.flatnonzero(part.family == FILTERED))
    return part._replace(log_prior=part.log_prior - np.logaddexp.reduce(part.log_prior))


def _with_lags(models: Models, those: Integers) -> Models:
    """Return models where each of `those`, which are next to each other, is one of each of
    `FINER_LAGS`."""
    if not those.size:
        return models
    lag = np.repeat(FINER_LAGS, len(those))
    every = np.insert(np.arange(len(models.lag)), those[0], np.tile(those, len(FINER_LAGS) - 1))
    models = Models._make(column[every] for column in models)
    new = slice(those[0], those[0] + len(lag))
    models.lag[new] = lag
    models.log_prior[new] += math.log(len(LAGS) / len(FINER_LAGS))
    models.initial[new, FILTER_ERROR - len(UNKNOWN)] = 0.5 * UNSURE_LAG * lag
    each = np.stack([models.family, models.noise, models.lag])
    begins = (each[:, 1:] != each[:, :-1]).any(axis=0)
    return models._replace(group=np.cumsum(np.append(False, begins)))
