"""Covariance of a field between places, as a survey shows it.

Two kinds, each a sum of two parts, one short and one long:

- `matern`: in the plane, sigma² (1 + a) exp(-a) with a = sqrt(3) d / length (Matérn 3/2,
  Rasmussen & Williams 2006, eq. 4.17). Distances are longer in one direction than across it by a
  ratio, after the strike of the geology, of the whole survey or of each place (`strike`). Heights
  do not count.
- `harmonic`: sigma² (2 D)² z / (d² + z²)^(3/2) with z = h + h' + 2 D, h being heights above the
  lowest reading. It is the covariance of a field that satisfies Laplace's equation above
  uncorrelated sources in a layer at depth D (Poisson's kernel; Moritz 1980, Advanced Physical
  Geodesy, sec. 22 to 24), so that kriging with it is a layer of equivalent sources whose damping
  is the noise of the readings, and continues the field to any height above.

To it come the noise of the readings and an offset of each survey line."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.maps.error_ellipses import joint

KINDS = ("matern", "harmonic")
JITTER = 1e-8
"""Share of the field's variance that is added to that of each reading."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """N readings of a field without its trend."""

    places: Array
    """(N, 3) east, north, height above the lowest reading, m."""
    value: Array
    """(N,)"""
    sigma: Array | None = None
    """(N,) 1-sigma of each; None = the covariance's noise alone."""
    line: Integers | None = None
    """(N,) survey line of each; None = stations."""

    def __len__(self) -> int:
        return len(self.value)

    @property
    def spread(self) -> float:
        """1-sigma of the values."""
        return float(np.std(self.value))

    def part(self, rows: Integers | Booleans) -> "Readings":
        """Return some of the readings."""
        return Readings(
            self.places[rows],
            self.value[rows],
            None if self.sigma is None else self.sigma[rows],
            None if self.line is None else self.line[rows],
        )


@dataclass(frozen=True, slots=True)
class Covariance:
    """Parameters, in the field's unit and m."""

    kind: str
    sigma: tuple[float, float]
    """1-sigma of the short and the long part."""
    length: tuple[float, float]
    """m: lengths (matern), or depths D below the lowest reading (harmonic)."""
    noise: float
    """1-sigma of the white noise of a reading, what varies between neighbours included."""
    line: float = 0.0
    """1-sigma of the offset of a survey line."""
    ratio: float = 1.0
    """Of lengths along the strike and across it (matern)."""
    strike: float = 0.0
    """rad, from east to north."""
    local: Callable[[Array], Array] | None = None
    """Strike of each place (`strike.local_strike`), instead of these two."""

    @property
    def variance(self) -> float:
        """Of the field at the lowest reading."""
        return sum(s**2 for s in self.sigma)

    @property
    def shortest(self) -> float:
        """Distance (m) that matters across the strike."""
        across = min(self.length) / math.sqrt(max(self.ratio, 1.0 / self.ratio))
        return across if self.kind == "matern" else 2.0 * across

    @property
    def unresolved(self) -> float:
        """Variance of what one reading has and the map does not, its known noise not included:
        what varies between neighbouring readings, and the offset of its line."""
        return self.noise**2 + self.line**2

    def between(self, here: Array, there: Array) -> Array:
        """Return (N, M) the covariance between places (N, 3) and (M, 3): east, north, height
        above the lowest reading, m."""
        from scipy.spatial.distance import cdist

        if self.kind == "matern":
            alike: Array | float = 1.0
            if self.local is None:
                apart = cdist(self.turned(here), self.turned(there))
            else:
                way = np.stack([here[:, k, None] - there[:, k] for k in (1, 0)])
                apart, alike = joint(way, self.local(here), self.local(there))
            total = np.zeros_like(apart)
            for sigma, length in zip(self.sigma, self.length, strict=True):
                a = (math.sqrt(3.0) / length) * apart
                total += sigma**2 * (1.0 + a) * np.exp(-a)
            return np.asarray(alike * total)
        square = cdist(here[:, :2], there[:, :2], "sqeuclidean")
        total = np.zeros_like(square)
        for sigma, depth in zip(self.sigma, self.length, strict=True):
            z = here[:, 2:] + there[:, 2] + 2.0 * depth
            total += (sigma * 2.0 * depth) ** 2 * z / (square + z * z) ** 1.5
        return total

    def variance_at(self, places: Array) -> Array:
        """Return (N,) the variance at places (N, 3)."""
        if self.kind == "matern":
            return np.full(len(places), self.variance)
        total = np.zeros(len(places))
        for sigma, depth in zip(self.sigma, self.length, strict=True):
            total += (sigma * depth / (places[:, 2] + depth)) ** 2
        return total

    def of_readings(self, readings: Readings) -> Array:
        """Return (N, N) the covariance of readings: field, noise and offsets of lines."""
        total = self.between(readings.places, readings.places)
        if self.line > 0.0 and readings.line is not None:
            total += self.line**2 * (readings.line[:, None] == readings.line)
        own = self.noise**2 + (0.0 if readings.sigma is None else readings.sigma**2)
        total[np.diag_indices(len(readings))] += own + JITTER * self.variance
        return total

    def turned(self, places: Array) -> Array:
        """Return (N, 2) places (N, 3) as they count for distances, along and across the strike."""
        c, s, root = math.cos(self.strike), math.sin(self.strike), math.sqrt(self.ratio)
        return places[:, :2] @ np.array([[c / root, -s * root], [s / root, c * root]])

    def describe(self) -> dict[str, object]:
        """Return the parameters for a report."""
        return {
            "kind": self.kind,
            "sigma": list(self.sigma),
            ("length_m" if self.kind == "matern" else "depth_m"): list(self.length),
            "noise": self.noise,
            "line_offset": self.line,
            "ratio": self.ratio,
            "strike_deg": math.degrees(self.strike) % 180.0,
        }
