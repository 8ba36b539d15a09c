"""Covariance of a field between places, as a survey shows it.

Two kinds, each a sum of two parts, one short and one long:

- `matern`: in the plane, sigma² (1 + a) exp(-a) with a = sqrt(3) d / length (Matérn 3/2,
  Rasmussen & Williams 2006, eq. 4.17). Distances are longer in one direction than across it by a
  ratio, after the strike of the geology. Heights do not count.
- `harmonic`: sigma² (2 D)² z / (d² + z²)^(3/2) with z = h + h' + 2 D, h being heights above the
  lowest reading. It is the covariance of a field that satisfies Laplace's equation above
  uncorrelated sources in a layer at depth D (Poisson's kernel; Moritz 1980, Advanced Physical
  Geodesy, sec. 22 to 24), so that kriging with it is a layer of equivalent sources whose damping
  is the noise of the readings, and continues the field to any height above.

To it come the noise of the readings and an offset of each survey line. All parameters are those
that make the readings most likely (Rasmussen & Williams, sec. 5.4), near each of some places of
the survey and around it."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.seeds import generator

KINDS = ("matern", "harmonic")
_NEAR, _AROUND, _PLACES = 120, 150, 10
"""Readings next to a place, drawn from those around it, and places that parameters are learnt
from."""
_JITTER = 1e-8


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

    @property
    def variance(self) -> float:
        """Of the field at the lowest reading."""
        return sum(s**2 for s in self.sigma)

    def between(self, here: Array, there: Array) -> Array:
        """Return (N, M) the covariance between places (N, 3) and (M, 3): east, north, height
        above the lowest reading, m."""
        from scipy.spatial.distance import cdist

        if self.kind == "matern":
            apart = cdist(here[:, :2] @ self._turn, there[:, :2] @ self._turn)
            total = np.zeros_like(apart)
            for sigma, length in zip(self.sigma, self.length, strict=True):
                a = (math.sqrt(3.0) / length) * apart
                total += sigma**2 * (1.0 + a) * np.exp(-a)
            return total
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

    def of_readings(self, places: Array, sigma: Array | None, line: Integers | None) -> Array:
        """Return (N, N) the covariance of readings: field, noise and offsets of lines."""
        total = self.between(places, places)
        if self.line > 0.0 and line is not None:
            total += self.line**2 * (line[:, None] == line)
        own = self.noise**2 if sigma is None else self.noise**2 + sigma**2
        total[np.diag_indices(len(places))] += own + _JITTER * self.variance
        return total

    @property
    def _turn(self) -> Array:
        """(2, 2) from east and north to lengths as they count, along and across the strike."""
        c, s, root = math.cos(self.strike), math.sin(self.strike), math.sqrt(self.ratio)
        return np.array([[c / root, -s * root], [s / root, c * root]])

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


def learn(
    places: Array,
    value: Array,
    sigma: Array | None,
    line: Integers | None,
    *,
    kind: str = "matern",
) -> Covariance:
    """Return the covariance that makes readings without their trend most likely.

    Parameters
    ----------
    places : (N, 3) m
    value : (N,)
    sigma, line : (N,) or None
        See `isogal.maps.gridding.survey.Survey`.
    kind : str
        One of `KINDS`.

    Raises
    ------
    InputError
        Values that are all the same.
    """
    from scipy.optimize import minimize

    spread = float(np.std(value))
    if not spread > 0.0:
        raise InputError("the readings are all the same; there is no field to map")
    samples = [
        (places[rows], value[rows] - value[rows].mean(), *_cut(sigma, line, rows))
        for rows in _neighbourhoods(places)
    ]
    extent = float(np.hypot(*np.ptp(places[:, :2], axis=0)))
    lined = line is not None and np.unique(line).size > 1
    start = _start(kind, spread, extent, lined)

    def cost(p: Array) -> float:
        covariance = _unpack(p, kind, lined)
        total = 0.5 * (p[4] - math.log(0.03 * spread)) ** 2  # about 3 %, within a factor e
        if lined:
            total += 0.5 * (p[5] - math.log(0.03 * spread)) ** 2
        for sample in samples:
            total += _misfit(covariance, 3.0 * spread, *sample)
        return total

    low = math.log(0.02 * _typical_gap(places))
    high = math.log(10.0 * extent)
    bounds: list[tuple[float | None, float | None]] = [(None, None)] * len(start)
    bounds[1] = bounds[3] = (low, high)
    if kind == "matern":
        bounds[-2] = (-1.5, 1.5)
    found = minimize(cost, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": 50})
    return _unpack(found.x, kind, lined)


def _start(kind: str, spread: float, extent: float, lined: bool) -> Array:
    lengths = (extent / 50.0, extent / 8.0)
    part = math.log(spread / math.sqrt(2.0))
    start = [part, math.log(lengths[0]), part, math.log(lengths[1]), math.log(0.05 * spread)]
    start += [math.log(0.03 * spread)] if lined else []
    return np.array([*start, *((0.1, 0.3) if kind == "matern" else ())])


def _unpack(p: Array, kind: str, lined: bool) -> Covariance:
    s1, l1, s2, l2, noise = (math.exp(min(x, 50.0)) for x in p[:5])
    ratio, strike = (math.exp(p[-2]), float(p[-1])) if kind == "matern" else (1.0, 0.0)
    return Covariance(
        kind, (s1, s2), (l1, l2), noise, math.exp(p[5]) if lined else 0.0, ratio, strike
    )


def _misfit(
    covariance: Covariance,
    level: float,
    places: Array,
    value: Array,
    sigma: Array | None,
    line: Integers | None,
) -> float:
    """Return minus the log-likelihood of readings about an unknown level (1-sigma)."""
    from scipy.linalg import LinAlgError, solve_triangular

    R = covariance.of_readings(places, sigma, line)
    R += level**2
    try:
        factor = np.linalg.cholesky(R)
    except (np.linalg.LinAlgError, LinAlgError):
        return 1e12
    white = solve_triangular(factor, value, lower=True, check_finite=False)
    return float(0.5 * white @ white + np.log(np.diag(factor)).sum())


def _neighbourhoods(places: Array) -> list[Integers]:
    """Return rows of readings near some places and around them; the same for the same places."""
    from scipy.spatial import cKDTree

    random = generator(0, 0, "gridding neighbourhoods")
    count = len(places)
    wide = min(count, max(2000, count // 8))
    tree = cKDTree(places[:, :2])
    chosen = []
    for centre in random.choice(count, min(_PLACES, count), replace=False):
        rows = np.atleast_1d(tree.query(places[centre, :2], wide)[1])
        around = random.choice(rows, min(_AROUND, rows.size), replace=False)
        chosen.append(np.unique(np.concatenate([rows[:_NEAR], around])))
    return chosen


def _typical_gap(places: Array) -> float:
    """Return the median distance to the next reading, m."""
    from scipy.spatial import cKDTree

    distance = cKDTree(places[:, :2]).query(places[:, :2], 2)[0][:, 1]
    return max(float(np.median(distance)), 1.0)


def _cut(
    sigma: Array | None, line: Integers | None, rows: Integers
) -> tuple[Array | None, Integers | None]:
    return (
        None if sigma is None else sigma[rows],
        None if line is None else line[rows],
    )
