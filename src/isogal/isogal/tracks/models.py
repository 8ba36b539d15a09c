"""Which errors of map and readings are possible for a recorded track, and how likely they are
before any reading: the bank's models (`isogal.matching.pmht.models`) with wider priors, since a
track is often all that one has.

The map's error holds together over a length, as a random walk that is drawn back or smoother, is
even (or as the map says where the track probably is) or goes with the map's gradient as that of
values that are displaced does, and the readings have an unknown constant or none; sigma is on a
logarithmic grid, and all combinations count. What a map says of its sigma at a place is the prior
there (docs/mathematics.md, section 10.2)."""

import math

import numpy as np
from scipy.special import logsumexp

from isogal.arrays import Array
from isogal.maps.channels import AnyMap
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.models import (
    BIASED,
    NOISIER,
    NONE,
    Assumed,
    Fault,
    Models,
    table_of,
)
from isogal.matching.pmht.models import assumed as assumed_of
from isogal.matching.pmht.states import States
from isogal.scenario import Matcher as MatcherSettings

LENGTHS = (700.0, 1400.0, 2800.0, 5600.0)
"""m, where none is specified: of the maps that are known to us."""
OWN = np.geomspace(0.2, 4.0, 9)
"""Factors on a sigma that the map has of its own, node by node."""
SHARES = (0.002, 1.0, 14)
"""Grid of a sigma that is not specified, least, largest, number: shares of the field's spread."""
PATTERNS = 2
EVEN, BY_GRADIENT = range(PATTERNS)
"""How the map's error varies along the track: as the map says where it probably is, or not; with
the map's gradient there."""
SHAPES = 2 * PATTERNS
"""Of the map's error for each length, so that `Models.shape` counts so many times as many: each
pattern as a random walk that is drawn back, and smoother."""
MISFITS, MISFIT_SHARE = (10.0, 100.0, 1e3, 1e4), 0.01
"""Factors on the variance of readings of several channels, in which an alignment or offset that
is not specified is no constant, and their probability."""


def track_models(
    settings: MatcherSettings, batch: Batch, field_map: AnyMap, states: States
) -> Models:
    """Return the models of a field, of one map with `SHAPES` for each length, by a scenario's
    matcher section: its defaults count as not specified; raises InputError on a bad
    option."""
    assumed, said = assumed_of(settings, batch, field_map), settings.model_fields_set
    one = field_map if isinstance(field_map, FieldMap) else None
    specified = "map_correlation_length" in said
    usual = assumed.length if specified else None
    if one is not None and one.error_ellipses is not None:
        specified &= usual != one.correlation_length
        usual = usual or one.correlation_length
    lengths, of_length = np.array(LENGTHS), np.zeros(len(LENGTHS))
    if usual is not None:
        factors = assumed.trust ** np.linspace(-1.0, 1.0, 3)
        lengths, of_length = _about(usual, assumed.trust, factors)
    if assumed.sigma is not None:
        uneven = one is not None and not isinstance(one.sigma, float)
        factors = OWN if uneven else assumed.trust ** np.linspace(-1.0, 1.0, 5)
        sigmas, of_sigma = _about(assumed.sigma, assumed.trust, factors)
    else:
        sigmas = assumed.scale * np.geomspace(*SHARES)
        of_sigma = np.zeros(len(sigmas))
    if not sigmas.any():
        sigmas, of_sigma, lengths, of_length = np.zeros(1), np.zeros(1), lengths[:1], np.zeros(1)
    errors = [
        (float(sigma), float(over), a + b)
        for sigma, a in zip(sigmas, of_sigma, strict=True)
        for over, b in zip(lengths, of_length, strict=True)
    ]
    faults = [Fault(NONE, 0.5), Fault(BIASED, 0.5, bias=1.0)]
    if not states.unknown:
        faults = [faults[0], *(Fault(NOISIER, MISFIT_SHARE, noise=factor) for factor in MISFITS)]
    elif "bias_sigma" in said:
        faults = faults[:1]
    rows = [(*error, fault) for fault in faults for error in errors]
    models = table_of(rows, assumed, states)
    if one is None:
        return models
    uneven = not isinstance(one.sigma, float)
    # a specified length is that of an exponential, not what the map says of its usual one
    return _of_shapes(models, uneven or assumed.sigma is None, not specified)


def _about(usual: float, trust: float, factors: Array) -> tuple[Array, Array]:
    """Return values at factors from a usual one that is right within a factor (1-sigma), and their
    log priors; that value alone where it is right to the letter."""
    if trust == 1.0:
        return np.array([usual]), np.zeros(1)
    return usual * factors, -0.5 * (np.log(factors) / math.log(trust)) ** 2


def _of_shapes(models: Models, by_gradient: bool, smooth: bool) -> Models:
    count, wrong = len(models.lengths), models.sigma > 0.0
    parts = [models]
    for kind in range(1, SHAPES):
        if (by_gradient or kind % PATTERNS == EVEN) and (smooth or kind < PATTERNS):
            part = Models._make(column[wrong] for column in models)
            parts.append(part._replace(shape=part.shape + kind * count))
    whole = Models._make(np.concatenate(columns) for columns in zip(*parts, strict=True))
    return whole._replace(log_prior=whole.log_prior - np.logaddexp.reduce(whole.log_prior))


def pattern_of(models: Models) -> Array:
    """Return (M,) how the map's error varies by each model."""
    return np.asarray(models.shape // len(models.lengths) % PATTERNS)


def stated_there(models: Models, assumed: Assumed, relative: Array) -> Array:
    """Return (M, C) what is added to the models' log prior at C places, of which the map says its
    1-sigma to be so many times (C,) that for which the prior holds."""
    sigmas, of_sigma = np.unique(models.sigma, return_inverse=True)
    if assumed.sigma is None or len(sigmas) == 1:
        return np.zeros((len(models.sigma), len(relative)))
    off = np.log(sigmas / assumed.sigma)[:, None] - np.append(0.0, np.log(relative))
    log = -0.5 * (off / math.log(assumed.trust)) ** 2
    log -= logsumexp(log, axis=0)
    return np.asarray(log[of_sigma, 1:] - log[of_sigma, :1])
