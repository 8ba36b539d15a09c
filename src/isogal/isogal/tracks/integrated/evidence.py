"""Log-likelihood of residuals at many shifts under many noise models at once.

With C C' = W, the eigenvectors U of C⁻¹ K C⁻' make R = s² K + W diagonal for every scale s:
y = U' C⁻¹ r has variances s² lambda + 1, and the offset of 1-sigma o, whose direction becomes
c = U' C⁻¹ 1, is integrated out (Woodbury). So one product of matrices for each correlation and
shape serves all scales and offsets (docs/mathematics.md, section 10.2)."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.tracks.integrated.noise_models import Correlation, NoiseModels


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What noise models need to know of a batch's rows."""

    distance: Array
    """(m, m) m; where the map's error holds together over lengths of its own, times the map's
    usual one over them."""
    known: Array
    """(m, m) W."""
    shapes: dict[str, Array]
    """(m,) 1-sigma of the map's error along the track by each shape, for a scale of 1."""
    alike: Array | float = 1.0
    """(m, m) factor of the correlations: below 1 where lengths differ from row to row."""

    def part(self, rows: int) -> "Surroundings":
        """Return what they need to know of the first rows alone."""
        alike = self.alike if isinstance(self.alike, float) else self.alike[:rows, :rows]
        shapes = {name: shape[:rows] for name, shape in self.shapes.items()}
        return Surroundings(self.distance[:rows, :rows], self.known[:rows, :rows], shapes, alike)

    def map_covariance(self, correlation: Correlation, shape: str) -> Array:
        """Return K (m, m)."""
        return self.alike * correlation.matrix(self.distance, self.shapes[shape])

    def covariance(
        self, correlation: Correlation, shape: str, scale: float, offset: float
    ) -> Array:
        """Return R (m, m)."""
        return scale**2 * self.map_covariance(correlation, shape) + self.known + offset**2


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
