"""Which errors of map and readings are possible, and how likely they are before any reading.

The covariance of the residuals is

    R = s² K + W + o² 1 1'      K_ij = d_i d_j c(|x_i - x_j|)

with W what is known (the sensor's noise, the doubt of a continued map), o the 1-sigma of an
unknown offset of the readings, and the map error's correlation c one of: exponentials of several
lengths, mixtures of one with another four times as long (errors of two scales), and smoother ones
(Matern 3/2; Rasmussen & Williams 2006, eq. 4.17), as errors of interpolation are. Its 1-sigma
along the track, d (RMS 1), is even, or goes with the map's own sigma where it has one; or it
goes mostly with the map's RMS gradient, as that of a map whose values are displaced does. The
scale s is on a logarithmic grid, and all combinations count."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array

UNKNOWN_LENGTHS = (700.0, 1400.0, 2800.0, 5600.0)
"""m, of an exponential or Matern correlation nobody has told: of the maps that are known to us."""
_TOLD_LENGTHS = (0.5, 1.0, 2.0)
"""Factors on a correlation length that was told."""
_TOLD_SIGMAS = (0.5, 0.7, 1.0, 1.4, 2.0)
"""Factors on a sigma that was told."""
_UNKNOWN_SHARES = (0.002, 1.0, 14)
"""Grid of a sigma that nobody has told, least, largest, number: shares of the field's spread."""
_OWN_SCALES = (0.2, 4.0, 9)
"""Grid of the factor on a sigma that the map has of its own."""
_OWN_SCALE_LOG_SIGMA = 0.5
"""1-sigma of the logarithm of that factor."""
_UNKNOWN_OFFSET_SHARE = 0.5
"""1-sigma of an offset that nobody has told, as a share of the field's spread."""
GRADIENT_SHARE = 0.9
"""Of the variance of errors that go with the gradient."""
_LONG_SHARE = 0.3
"""Of the variance of errors of two scales that is correlated over four times the length."""
_NUGGET = 0.01
"""Share of a smooth error's variance that is not correlated: keeps it regular."""


@dataclass(frozen=True, slots=True)
class Told:
    """What somebody has said about the noise, map's unit and m; None = nothing."""

    sigma: float | None = None
    """1-sigma of the map's error; where the map says a larger one, that counts."""
    correlation_length: float | None = None
    offset_sigma: float | None = None
    trust: float = 2.0
    """Factor within which sigma and length are right (1-sigma); 1 = to the letter."""


@dataclass(frozen=True, slots=True)
class Correlation:
    """A correlation function of the map's error."""

    length: float
    """m."""
    smooth: bool = False
    """Matern 3/2 instead of exponential."""
    long_share: float = 0.0
    """Of the variance, with four times the length."""

    def matrix(self, distance: Array, shape: Array) -> Array:
        """Return K (m, m) for distances (m, m) in m and 1-sigmas d (m,)."""
        even = np.outer(shape, shape)
        if self.smooth:
            a = math.sqrt(3.0) * distance / self.length
            smooth = (1.0 + a) * np.exp(-a) * even
            return (1.0 - _NUGGET) * smooth + _NUGGET * np.diag(shape**2)
        near = np.exp(-distance / self.length) * even
        if not self.long_share:
            return near
        far = float(np.mean(shape**2)) * np.exp(-distance / (4.0 * self.length))
        return (1.0 - self.long_share) * near + self.long_share * far


@dataclass(frozen=True, slots=True, eq=False)
class NoiseModels:
    """A grid of correlations x shapes x scales x offsets, with log prior probabilities."""

    correlations: tuple[Correlation, ...]
    shapes: tuple[str, ...]
    """`even` (or the map's own) and `gradient`."""
    scales: Array
    """(K,) s."""
    offsets: Array
    """(B,) 1-sigma of the unknown offset."""
    log_prior: Array
    """(correlations, shapes, K, B)."""

    @property
    def screening(self) -> "NoiseModels":
        """A few of them, for a first look at many shifts."""
        lengths = np.array([c.length for c in self.correlations])
        middle = int(np.argmin(np.abs(np.log(lengths / np.exp(np.log(lengths).mean())))))
        return NoiseModels(
            (self.correlations[middle],),
            self.shapes,
            self.scales,
            self.offsets,
            self.log_prior[middle : middle + 1],
        )


def noise_models(told: Told, own_sigma: bool, spread: float) -> NoiseModels:
    """Return the models that are possible.

    Parameters
    ----------
    told : Told
    own_sigma : bool
        Whether the map has a 1-sigma of its own, place by place: `even` then means that.
    spread : float
        Standard deviation of the field.
    """
    loose = math.log(max(told.trust, 1.0 + 1e-9))
    correlations, of_length = _correlations(told, loose)
    shapes = ("even",) if told.sigma is not None and not own_sigma else ("even", "gradient")
    scales, of_scale = _scales(told, own_sigma, spread, loose)
    offsets, of_offset = _offsets(told, spread)
    prior = (
        of_length[:, None, None, None]
        + np.zeros(len(shapes))[:, None, None]
        + of_scale[:, None]
        + of_offset
    )
    prior -= np.log(np.exp(prior - prior.max()).sum()) + prior.max()
    return NoiseModels(correlations, shapes, scales, offsets, prior)


def _correlations(told: Told, loose: float) -> tuple[tuple[Correlation, ...], Array]:
    if told.sigma == 0.0:
        return (Correlation(1.0),), np.zeros(1)
    lengths: Sequence[float] = UNKNOWN_LENGTHS
    if told.correlation_length is not None:
        factors = (1.0,) if told.trust == 1.0 else _TOLD_LENGTHS
        lengths = [f * told.correlation_length for f in factors]
    each = [
        *(Correlation(length) for length in lengths),
        *(Correlation(length, long_share=_LONG_SHARE) for length in lengths),
        *(Correlation(length / math.sqrt(2.0), smooth=True) for length in lengths),
    ]
    if told.trust == 1.0 and told.correlation_length is not None:
        each = each[:1]
    if told.correlation_length is None:
        return tuple(each), np.zeros(len(each))
    away = np.log(np.tile(lengths, 3)[: len(each)] / told.correlation_length)
    return tuple(each), -0.5 * (away / loose) ** 2


def _scales(told: Told, own_sigma: bool, spread: float, loose: float) -> tuple[Array, Array]:
    if told.sigma == 0.0 and not own_sigma:
        return np.zeros(1), np.zeros(1)
    if own_sigma:
        scales = np.ones(1) if told.trust == 1.0 else np.geomspace(*_OWN_SCALES)
        return scales, -0.5 * (np.log(scales) / _OWN_SCALE_LOG_SIGMA) ** 2
    if told.sigma is not None:
        factors = np.ones(1) if told.trust == 1.0 else np.array(_TOLD_SIGMAS)
        return told.sigma * factors, -0.5 * (np.log(factors) / loose) ** 2
    least, most, number = _UNKNOWN_SHARES
    return spread * np.geomspace(least, most, number), np.zeros(number)


def _offsets(told: Told, spread: float) -> tuple[Array, Array]:
    if told.offset_sigma is not None:
        return np.array([told.offset_sigma]), np.zeros(1)
    return np.array([0.0, _UNKNOWN_OFFSET_SHARE * spread]), np.log([0.5, 0.5])
