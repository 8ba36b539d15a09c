"""The errors of a map as a random field: how large, and over which distance they hold together,
after an operator that depends on the wavelength alone.

The error of the values has the covariance of `isogal.maps.error_model`, sigma² exp(-d / L), thus
the spectrum

    S(k) = sigma² L² / (1 + k² L²)^(3/2),   the integral of S(k) k dk being sigma²,

and the rounding of the values to be white noise up to the highest wavenumber of the grid. After an
operator of factor O(k) variance and correlation are

    v = ∫ S O² k dk,   c(d) = 1/v ∫ S O² J0(k d) k dk.

For upward continuation by h, O = exp(-k h), that is sigma² (1 - a π/2 (H0(a) - Y0(a))) with
a = 2 h / L (H0: Struve function): sigma falls as L / (2 h) where h is much larger than L. The
distance at which the correlation is 1/e grows from L to 1.95 h, as then
c(d) = (1 + (d / 2h)²)^(-3/2)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.maps.error_model import decay
from isogal.maps.field_map import FieldMap

USUAL_LENGTH = 4000.0
"""m, correlation length of a map's error where the map does not say it (the scenario's
default)."""
_NODES = 4000

Factor = Callable[[Array], Array]
"""Of an operator, at wavenumbers (rad/m)."""


@dataclass(frozen=True)
class ErrorSpectrum:
    """Variance of a map's error by wavenumber: a part with a correlation length, and rounding."""

    wavenumber: Array
    """(K,) rad/m, up to the highest of the grid."""
    correlated: Array
    """(K,) share of the variance of errors of 1-sigma one that each wavenumber has."""
    white: Array
    """(K,) likewise, of white noise of the nodes."""
    sigma: float
    """1-sigma of the correlated errors."""
    rounding: float
    """1-sigma of the white noise."""

    @classmethod
    def of_map(cls, field_map: FieldMap) -> "ErrorSpectrum":
        """Return that of what a map says of its errors: the root mean square over its nodes, and
        the rounding of its values."""
        # the disc whose area is that of the rectangle of wavenumbers that the grid can show
        highest = 2.0 * math.sqrt(math.pi / math.prod(field_map.cell))
        edges = highest * np.linspace(0.0, 1.0, _NODES + 1) ** 3  # denser at long waves
        scaled = (edges * (field_map.correlation_length or USUAL_LENGTH)) ** 2
        # exact integrals over each interval of k dk / (1 + k² L²)^(3/2) and of k dk
        correlated = -np.diff(1.0 / np.sqrt(1.0 + scaled))
        white = np.diff(edges**2) / highest**2
        # what is shorter than the grid can show is folded into what it shows
        correlated += (1.0 - correlated.sum()) * white
        return cls(
            0.5 * (edges[1:] + edges[:-1]),
            correlated,
            white,
            sigma=float(np.sqrt(np.nanmean(np.square(field_map.sigma)))),
            rounding=field_map.quantisation / math.sqrt(12.0),
        )

    def gain(self, factor: Factor) -> float:
        """Return the 1-sigma after an operator of correlated errors of 1-sigma one."""
        return math.sqrt(float((self.correlated * factor(self.wavenumber) ** 2).sum()))

    def white_gain(self, factor: Factor) -> float:
        """Return the 1-sigma after an operator of white noise of 1-sigma one."""
        return math.sqrt(float((self.white * factor(self.wavenumber) ** 2).sum()))

    def length(self, factor: Factor) -> float | None:
        """Return the distance (m) at which errors after an operator have a correlation of 1/e;
        None where there are no errors."""
        from scipy.special import j0

        power = self.sigma**2 * self.correlated + self.rounding**2 * self.white
        power *= factor(self.wavenumber) ** 2
        if not power.any():
            return None
        power /= power.sum()
        return _correlation_length(
            lambda distance: float((power * j0(self.wavenumber * distance)).sum()),
            1.0 / float((power * self.wavenumber).sum()),
        )


def upward(height: float) -> Factor:
    """Return the factor of a continuation upwards by a height (m)."""
    return lambda wavenumber: np.exp(-wavenumber * height)


def mixed_length(parts: Sequence[tuple[float, float | None]]) -> float | None:
    """Return the distance (m) at which the sum of independent errors with covariances
    v exp(-d / L) has a correlation of 1/e.

    Parameters
    ----------
    parts : sequence of (float, float)
        Variance v and length L (m) of each error; only those count that are not zero. None = no
        error at all.
    """
    errors = [(variance, length) for variance, length in parts if variance and length]
    if not errors:
        return None
    variance, length = np.transpose(errors)
    return _correlation_length(
        lambda distance: float((variance * decay(distance, length)).sum() / variance.sum()),
        float(length.max()),
    )


def _correlation_length(correlation: Callable[[float], float], first: float) -> float:
    """Return the distance (m) at which a correlation is 1/e, by bisection from a first guess."""
    low, high = 0.0, first
    while correlation(high) > math.exp(-1.0):
        low, high = high, 1.5 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if correlation(middle) > math.exp(-1.0) else (low, middle)
    return high
