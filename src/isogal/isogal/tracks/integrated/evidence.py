"""Log-likelihood of residuals at many shifts under many noise models at once.

With C C' = W, the eigenvectors U of C⁻¹ K C⁻' make R = s² K + W diagonal for every scale s:
y = U' C⁻¹ r has variances s² lambda + 1, and the offset of 1-sigma o, whose direction becomes
c = U' C⁻¹ 1, is integrated out (Woodbury). So one product of matrices for each correlation and
shape serves all scales and offsets (docs/mathematics.md, section 10.2)."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.tracks.integrated.noise_models import Correlation, NoiseModels

_ROUNDING = 1e-9
"""Of the largest eigenvalue of a covariance, by which the least may be below 0."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What noise models need to know of a batch's rows."""

    distance: Array
    """(p, p) m, between points; where the map's error holds together over lengths of its own,
    times the map's usual one over them."""
    known: Array
    """(m, m) W."""
    shapes: dict[str, Array]
    """(m,) 1-sigma of the map's error along the track by each shape, for a scale of 1."""
    alike: Array | float = 1.0
    """(p, p) factor of the correlations: below 1 where lengths differ from row to row."""
    point_row: Integers | None = None
    """(p,) row of each point, in order; None = points are rows. The covariance of rows is that of
    their points averaged."""

    def part(self, rows: int) -> "Surroundings":
        """Return what they need to know of the first rows alone."""
        points, of = rows, self.point_row
        if of is not None:
            points = int(np.searchsorted(of, rows))
            of = of[:points]
        alike = self.alike if isinstance(self.alike, float) else self.alike[:points, :points]
        shapes = {name: shape[:rows] for name, shape in self.shapes.items()}
        distance = self.distance[:points, :points]
        return Surroundings(distance, self.known[:rows, :rows], shapes, alike, of)

    def map_covariance(self, correlation: Correlation, shape: str) -> Array:
        """Return K (m, m)."""
        of, deviation = self.point_row, self.shapes[shape]
        at_points = deviation if of is None else deviation[of]
        return row_means(self.alike * correlation.matrix(self.distance, at_points), of)

    def covariance(
        self, correlation: Correlation, shape: str, scale: float, offset: float
    ) -> Array:
        """Return R (m, m)."""
        return scale**2 * self.map_covariance(correlation, shape) + self.known + offset**2


def row_means(covariance: Array, point_row: Integers | None) -> Array:
    """Return (m, m) the covariance of rows by that of their points (p, p), averaged."""
    if point_row is None or len(point_row) == point_row[-1] + 1:
        return covariance
    first = np.flatnonzero(np.diff(point_row, prepend=-1))
    count = np.bincount(point_row)
    sums = np.add.reduceat(np.add.reduceat(covariance, first, axis=0), first, axis=1)
    return np.asarray(sums / np.outer(count, count))


def log_likelihoods(residual: Array, models: NoiseModels, around: Surroundings) -> Array:
    """Return (correlations, shapes, scales, offsets, S) log densities of residuals (m, S)."""
    rows, count = residual.shape
    result = np.empty((*models.log_prior.shape, count))
    factor = np.linalg.cholesky(around.known)
    inverse = np.linalg.inv(factor)
    whitened, ones = inverse @ residual, inverse.sum(axis=1)
    constant = float(np.log(np.diag(factor)).sum()) + 0.5 * rows * math.log(2.0 * math.pi)
    for i, correlation in enumerate(models.correlations):
        for j, shape in enumerate(models.shapes):
            covariance = around.map_covariance(correlation, shape)
            relative = inverse @ covariance @ inverse.T
            values, vectors = np.linalg.eigh(0.5 * (relative + relative.T))
            if not values[0] >= -_ROUNDING * max(values[-1], 1.0):
                raise np.linalg.LinAlgError("the map's errors at the rows have no covariance")
            rotated, level = vectors.T @ whitened, vectors.T @ ones
            precision = 1.0 / (models.scales[:, None] ** 2 * np.maximum(values, 0.0) + 1.0)
            along = ((precision * level) @ rotated) ** 2  # (scales, S)
            misfit = precision @ np.square(rotated, out=rotated)
            own = precision @ level**2
            half = 0.5 * np.log(precision).sum(axis=1) - constant
            for b, offset in enumerate(models.offsets):
                more = 1.0 + offset**2 * own
                out = result[i, j, :, b]  # in place: these arrays are large
                np.multiply((offset**2 / more)[:, None], along, out=out)
                out -= misfit
                out *= 0.5
                out += (half - 0.5 * np.log(more))[:, None]
    return result
