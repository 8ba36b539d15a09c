"""What is done to readings before they are gridded: trend, and blocks."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.maps.gridding.survey import Survey

_ROUNDS = 20
"""Of reweighting."""


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """A polynomial of the plane's coordinates."""

    degree: int
    scale: float
    """m, of one in the polynomial."""
    coefficients: Array

    @classmethod
    def fitted(cls, places: Array, value: Array, degree: int) -> "Trend":
        """Fit by least squares; where readings lie 3 and more 1-sigma off they count less (Huber
        1964), so that strong anomalies do not tilt it."""
        scale = float(np.abs(places[:, :2]).max()) or 1.0
        basis = _basis(places, scale, degree)
        weight: Any = np.ones(len(value))
        coefficients = np.zeros(basis.shape[1])
        for _ in range(_ROUNDS):
            coefficients = np.linalg.lstsq(basis * weight[:, None], value * weight, rcond=None)[0]
            residual = np.abs(value - basis @ coefficients)
            usual = 3.0 * 1.4826 * float(np.median(residual)) + 1e-300
            weight = np.sqrt(np.minimum(1.0, usual / np.maximum(residual, 1e-300)))
        return cls(degree, scale, coefficients)

    def at(self, places: Array) -> Array:
        """Return (N,) the trend at places (N, 2+), m."""
        return np.asarray(_basis(places, self.scale, self.degree) @ self.coefficients)


def _basis(places: Array, scale: float, degree: int) -> Array:
    x, y = places[:, 0] / scale, places[:, 1] / scale
    return np.stack(
        [x**i * y ** (total - i) for total in range(degree + 1) for i in range(total + 1)], axis=1
    )


def block_reduced(survey: Survey, places: Array, side: float) -> Survey:
    """Return a survey with one reading for each block of the plane and each line in it: the mean
    of its readings at the mean of their places.

    Parameters
    ----------
    survey : Survey
    places : (N, 2) m
    side : float
        Of a block, m; 0 = all readings are kept.

    Notes
    -----
    A mean of n readings has 1-sigma over sqrt(n) where the survey says 1-sigmas.
    """
    if side <= 0.0:
        return survey
    cell = np.floor((places - places.min(axis=0)) / side).astype(np.int64)
    line = np.zeros(len(survey), dtype=np.int64) if survey.line is None else survey.line
    _, first, group = np.unique(
        np.column_stack([line, cell]), axis=0, return_index=True, return_inverse=True
    )
    group = group.reshape(-1)
    count = np.bincount(group)

    def mean(values: Array) -> Array:
        return np.bincount(group, values) / count

    return replace(
        survey,
        latitude=mean(survey.latitude),
        longitude=mean(survey.longitude),
        value=mean(survey.value),
        height=None if survey.height is None else mean(survey.height),
        sigma=None if survey.sigma is None else np.sqrt(mean(survey.sigma**2) / count),
        line=None if survey.line is None else survey.line[first],
    )
