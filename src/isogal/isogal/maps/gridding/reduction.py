"""What is done to readings before they are gridded: trend, and blocks."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.groups import Groups
from isogal.maps.gridding.survey import FEWEST, Survey, blocks_of

_FAR, _ROUNDS = 3.0, 20
"""1-sigmas off which a reading counts less for the trend, and rounds of reweighting."""


def huber_weights(residual: Array, limit: float) -> Array:
    """Return (N,) weights of values in a least-squares fit that leaves residuals (N,): less than
    one for those further off than so many 1-sigmas, by the median (Huber 1964)."""
    size = np.abs(residual)
    usual = limit * 1.4826 * float(np.median(size)) + 1e-300
    return np.minimum(1.0, usual / np.maximum(size, 1e-300))


def fitted_trend(places: Array, value: Array, degree: int) -> Callable[[Array], Array]:
    """Return what gives, at places (P, 2+), the polynomial of the plane's coordinates that fits
    values (N,) at places (N, 2+) by least squares, such that strong anomalies do not tilt it."""
    scale = float(np.abs(places[:, :2]).max()) or 1.0
    basis = _basis(places, scale, degree)
    weight: Array = np.ones(len(value))
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(basis * root[:, None], value * root, rcond=None)[0]
        weight = huber_weights(value - basis @ found, _FAR)
    return lambda places: np.asarray(_basis(places, scale, degree) @ found)


def _basis(places: Array, scale: float, degree: int) -> Array:
    x, y = places[:, 0] / scale, places[:, 1] / scale
    return np.stack(
        [x**i * y ** (total - i) for total in range(degree + 1) for i in range(total + 1)], axis=1
    )


def block_reduced(survey: Survey, side: float) -> Survey:
    """Return a survey with one reading for each block of the plane and each line in it: the mean
    of its readings at the mean of their places.

    Parameters
    ----------
    survey : Survey
    side : float
        Of a block, m; 0 = all readings are kept.

    Notes
    -----
    A mean of n readings has 1-sigma over sqrt(n) where the survey says 1-sigmas.
    """
    if side <= 0.0:
        return survey
    line = np.zeros(len(survey)) if survey.line is None else survey.line
    groups = Groups.by(line, blocks_of(survey.places, side))
    if groups.count.size < FEWEST:
        raise InputError(
            f"{survey.where}: blocks of {side:g} m (--block, or half of --spacing) leave"
            f" {groups.count.size} readings; at least {FEWEST} are needed"
        )
    mean, sigma = groups.mean, survey.sigma
    return replace(
        survey,
        latitude=mean(survey.latitude),
        longitude=mean(survey.longitude),
        value=mean(survey.value),
        height=None if survey.height is None else mean(survey.height),
        sigma=None if sigma is None else np.sqrt(mean(sigma**2) / groups.count),
        line=None if survey.line is None else survey.line[groups.first],
        time=None if survey.time is None else mean(survey.time),
    )
