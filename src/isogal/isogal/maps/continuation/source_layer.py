"""Sources below the ground that make a given field on it, by Fourier transform.

A field that is harmonic above the ground is that of a layer of sources which follows the ground at
some depth below it. Here the layer is spread over horizontal levels, level j at the height z_j: a
source between levels is shared by the four around it, such that polynomials up to the third degree
are kept, and the field on the ground is interpolated likewise between levels. From level to level
the field of sources of density s below it is a convolution: with the transform S its own is
S exp(-|k| (z - z_j)), and that of sources above it -S exp(-|k| (z_j - z)). That gives the field
anywhere above the ground, also beside and below summits, with a few transforms for each level.

The density is found by iteration: a residual on the ground is continued down to the layer as over
flat ground, s += F^-1[e / (1 + 0.001 e²) F r] with e = exp(|k| depth). Over flat ground one step
finds it but for the shortest waves; each further one makes the residual smaller by a factor that
grows with the slopes (0.1 to 0.3). The scheme is that of Xia, Sprowl and Adkins-Heljeson (1993,
Geophysics 58, 515-520), with a layer that follows the ground instead of a plane below it. Depth
and distance of levels are those at which point masses under mountains were best continued: the
four levels of a source and the four of the field above it must not overlap."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Integers
from isogal.maps.spectral import waves_of

SPACING = 0.5
"""Distance of levels, in cells."""
DEPTH = 4
"""Depth of the layer below the ground, in levels."""
_MOST_LEVELS = 64
"""Where the relief is larger, levels lie farther apart."""
_DAMPING = 1e-3
_MOST_STEPS = 12
_ENOUGH = 1e-4
"""Residual to stop at, as a share of the field."""
_PROGRESS = 0.8
"""A step must reduce the residual to this share, or it is the last, but for the first few: short
waves that the damping keeps out hide what they do."""
_LEAST_STEPS = 4

Single = NDArray[np.float32]
"""Single precision: half of the time and memory, and 1e-5 of the field at worst."""


class Scale(NamedTuple):
    """Metres of a column's width, and in which rows they count."""

    columns_m: float
    weight: Single
    """(n,)"""


class SourceLayer:
    """Sources below a ground.

    Parameters
    ----------
    terrain : (n, m)
        m; taken to be periodic.
    rows_m : float
        Distance of rows.
    scales : sequence of Scale
        Distance of columns; several, with weights by row, where it is not the same in all rows.
    """

    def __init__(self, terrain: Single, rows_m: float, scales: Iterable[Scale]) -> None:
        self.shape = terrain.shape
        self.scales = tuple(scales)
        self.rows_m = rows_m
        cell = min(rows_m, *(scale.columns_m for scale in self.scales))
        lowest, highest = float(terrain.min()), float(terrain.max())
        self.spacing = max(SPACING * cell, (highest - lowest) / (_MOST_LEVELS - DEPTH - 6))
        self.bottom = lowest - (DEPTH + 2) * self.spacing
        self.ground = ((terrain - self.bottom) / self.spacing).astype(np.float32)
        self.levels = math.floor((highest - self.bottom) / self.spacing) + 3
        below = np.floor(self.ground).astype(np.int64).ravel()
        self._order = np.argsort(below, kind="stable")
        self._place = self.ground.ravel()[self._order]
        self._first = np.searchsorted(below[self._order], np.arange(-2, self.levels + DEPTH + 3))

    def on_level(self, level: int) -> tuple[Integers, Single]:
        """Return which nodes of the ground have a share in a level, by their flat index (P,), and
        their weights (P,) in cubic Lagrange interpolation between levels. Those of the sources are
        the same, `DEPTH` levels below."""
        near = slice(self._first[level], self._first[level + 4])
        u = np.abs(self._place[near] - np.float32(level))
        weight = (2.0 - u) * np.where(u <= 1.0, (1.0 - u * u) / 2.0, (1.0 - u) * (3.0 - u) / 6.0)
        return self._order[near], weight

    def field(self, density: Single) -> Single:
        """Return the field (n, m) on the ground of sources of a density (n, m)."""
        from scipy.fft import irfft2

        field = np.zeros(self.shape, dtype=np.float32)
        decays = [np.exp(-self.spacing * self._size(scale)) for scale in self.scales]
        for levels, sign in (
            (range(self.levels), 1.0),
            (range(self.levels - 1, -1, -1), -1.0),
        ):
            passed = [np.zeros(decay.shape, dtype=np.complex64) for decay in decays]
            for level in levels:
                near, weight = self.on_level(level)
                for scale, spectrum in zip(self.scales, passed, strict=True):
                    plane = irfft2(spectrum, self.shape).ravel()
                    of_row = np.float32(sign) * scale.weight[near // self.shape[1]]
                    field.ravel()[near] += of_row * plane[near] * weight
                own = self._transform(density, level)
                for i, decay in enumerate(decays):
                    passed[i] += own
                    passed[i] *= decay
        return field

    def field_at(self, density: Single, height: float) -> Single:
        """Return the field (n, m) at a height (m), of use where that is above the ground."""
        from scipy.fft import irfft2

        field = np.zeros(self.shape, dtype=np.float32)
        sizes = [self._size(scale) for scale in self.scales]
        passed = [np.zeros(size.shape, dtype=np.complex64) for size in sizes]
        for level in range(self.levels):
            own = self._transform(density, level)
            rise = np.float32(height - self.bottom - level * self.spacing)
            for i, size in enumerate(sizes):
                passed[i] += np.sign(rise) * own * np.exp(-np.abs(rise) * size)
        for scale, spectrum in zip(self.scales, passed, strict=True):
            field += scale.weight[:, None] * irfft2(spectrum, self.shape)
        return field

    def solve(self, values: Single, counts: tuple[slice, slice]) -> tuple[Single, Single]:
        """Return the density whose field on the ground is nearest to values (n, m), and what it
        leaves unexplained; only the part `counts` decides when it is near enough."""
        from scipy.fft import irfft2, rfft2

        growth = np.exp(DEPTH * self.spacing * self._size(self.scales[len(self.scales) // 2]))
        inverse = growth / (1.0 + np.float32(_DAMPING) * growth * growth)
        inverse[~np.isfinite(inverse)] = 0.0
        density, rest = np.zeros_like(values), values
        size = last = _rms(values[counts])
        for step in range(_MOST_STEPS):
            trial = density + irfft2(rfft2(rest) * inverse, self.shape)
            rest_of_trial = values - self.field(trial)
            now = _rms(rest_of_trial[counts])
            if now >= last:
                break
            density, rest = trial, rest_of_trial
            if now < _ENOUGH * size or (step >= _LEAST_STEPS and now > _PROGRESS * last):
                break
            last = now
        return density, rest

    def _size(self, scale: Scale) -> Single:
        """Return |k| (n, m // 2 + 1), rad/m."""
        return waves_of(self.shape, (self.rows_m, scale.columns_m)).size.astype(np.float32)

    def _transform(self, density: Single, level: int) -> NDArray[np.complex64]:
        """Return the transform of the sources on a level."""
        from scipy.fft import rfft2

        near, weight = self.on_level(level + DEPTH)
        plane = np.zeros(self.shape, dtype=np.float32)
        plane.ravel()[near] = density.ravel()[near] * weight
        return rfft2(plane, overwrite_x=True)


def _rms(values: Single) -> float:
    return math.sqrt(float(np.mean(np.square(values, dtype=np.float64))))
