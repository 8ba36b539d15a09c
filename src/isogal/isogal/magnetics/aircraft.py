"""A magnetic aircraft built by hand: a permanent moment, a susceptibility tensor and an eddy
tensor that act on the true field vector, and the errors of the instruments. Nothing here knows the
Tolles-Lawson terms, so that it can check them (docs/magnetometer.md, section 6)."""

from dataclasses import dataclass, field

import numpy as np

from isogal.arrays import Array
from isogal.magnetics.terms import SCALE


@dataclass(frozen=True, eq=False)
class MagneticAircraft:
    """What the aircraft adds to the field at a magnetometer."""

    permanent: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) nT, body axes."""
    induced: Array = field(default_factory=lambda: np.zeros((3, 3)))
    """(3, 3) added field in a field of 1."""
    eddy: Array = field(default_factory=lambda: np.zeros((3, 3)))
    """(3, 3) s, added field in a field that changes by 1 in a second."""

    def field_on_board(self, vector: Array, rate: Array) -> Array:
        """Return (..., 3) nT the whole field on board in one (nT) that changes by `rate` (nT/s),
        both in body axes."""
        return vector + self.permanent + vector @ self.induced.T + rate @ self.eddy.T

    def coefficients(self) -> Array:
        """Return (18,) what the terms of `isogal.magnetics.terms` should come out as, to first
        order in the aircraft's field."""
        symmetric = self.induced + self.induced.T
        upper = symmetric[np.triu_indices(3)]
        upper[[0, 3, 5]] /= 2.0
        return np.concatenate([self.permanent, upper * SCALE, self.eddy.ravel() * SCALE])


@dataclass(frozen=True, eq=False)
class VectorErrors:
    """Errors of a vector magnetometer."""

    matrix: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) scale factors, axes that are not square, misalignment."""
    offset: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) nT."""
    noise: float = 0.0
    """1-sigma of each component, nT."""

    def read(self, vector: Array, random: np.random.Generator) -> Array:
        """Return (..., 3) what it reads in a field."""
        noise = self.noise * random.standard_normal(vector.shape)
        return vector @ self.matrix.T + self.offset + noise
