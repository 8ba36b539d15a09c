"""What is done to readings before they are gridded: trend, and blocks."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.maps.gridding.survey import Groups, Survey, blocks_of


def robust_fit(
    design: Array, value: Array, limit: float, rounds: int, ridge: float = 0.0
) -> Array:
    """Return the coefficients (C,) of a least-squares fit in which values far off count less
    (Huber 1964).

    Parameters
    ----------
    design : (N, C) array
    value : (N,) array
    limit : float
        1-sigmas (by the median) off which a value's weight begins to fall.
    rounds : int
        Of reweighting.
    ridge : float
        Added to the diagonal of the normal equations.
    """
    small = math.sqrt(ridge) * np.eye(design.shape[1])
    weight: Array = np.ones(len(value))
    coefficients: Array = np.zeros(design.shape[1])
    for _ in range(rounds):
        left, right = design * weight[:, None], value * weight
        if ridge:
            left, right = np.concatenate([left, small]), np.pad(right, (0, len(small)))
        coefficients = np.asarray(np.linalg.lstsq(left, right, rcond=None)[0])
        residual = np.abs(value - design @ coefficients)
        usual = limit * 1.4826 * float(np.median(residual)) + 1e-300
        weight = np.sqrt(np.minimum(1.0, usual / np.maximum(residual, 1e-300)))
    return coefficients


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """A polynomial of the plane's coordinates."""

    degree: int
    scale: float
    """m, of one in the polynomial."""
    coefficients: Array

    @classmethod
    def fitted(cls, places: Array, value: Array, degree: int) -> "Trend":
        """Fit by least squares, such that strong anomalies do not tilt it (`robust_fit`)."""
        scale = float(np.abs(places[:, :2]).max()) or 1.0
        basis = _basis(places, scale, degree)
        return cls(degree, scale, robust_fit(basis, value, limit=3.0, rounds=20))

    def at(self, places: Array) -> Array:
        """Return (N,) the trend at places (N, 2+), m."""
        return np.asarray(_basis(places, self.scale, self.degree) @ self.coefficients)


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
