"""`point-mass`: Bayes' rule on a grid of position errors.

Sources: Bucy & Senne (1971), "Digital synthesis of non-linear filters", Automatica 7(3):287-298;
Bergman (1999), "Recursive Bayesian estimation: navigation and tracking applications", thesis,
Linköping University, chapter 5, for terrain navigation and the adaptive grid.

The grid is over the position error at the batch end. Velocity error and the readings' bias move
the residuals linearly (metres within a batch), so at each node they are integrated out exactly,
linearised at their mean given the node's position. The grid starts over the whole prior with a
tempered likelihood (raised to a power beta so small that many nodes carry weight), is laid anew
over what carries weight, and so on until beta is 1; so a posterior that fits between the nodes of
the first grid is found."""

import math
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import value_and_gradient
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import ReadingArrays, UsableReadings, publish_posterior
from isogal.matching.interfaces import Batch, Fix, declined


class PointMassOptions(BaseModel):
    """Options of `point-mass`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    nodes: int = Field(25, ge=9, le=501, description="nodes along a side")
    extent: float = Field(
        4.5, gt=1.0, description="half-width of the first grid in 1-sigma of the prior"
    )
    support: float = Field(
        20.0, gt=1.0, description="effective nodes that a tempered likelihood must leave"
    )
    cut: float = Field(
        1e-5,
        gt=0.0,
        lt=1.0,
        description="nodes below this share of the heaviest are left out of the next grid",
    )
    levels: int = Field(10, ge=1, le=50, description="most grids")


class PointMass(Baseline[PointMassOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "point-mass"
    options_model = PointMassOptions

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        options = self.options
        prior = batch.prior[:2, :2]
        gain = np.linalg.solve(prior, batch.prior[:2, 2:]).T
        linear = np.zeros((3, 3))
        linear[:2, :2] = batch.prior[2:, 2:] - gain @ batch.prior[:2, 2:]
        linear[2, 2] = self.noise.bias_sigma**2
        information, certainty = np.linalg.inv(prior), readings.arrays.sigma**-2.0
        # the grid lies along the axes of the nodes that carry weight; at first, of the prior
        centre = np.zeros(2)
        axes = np.asarray(np.linalg.cholesky(prior), dtype=np.float64) * options.extent
        side = np.linspace(-1.0, 1.0, options.nodes)
        unit = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
        for level in range(1, options.levels + 1):
            position = np.ascontiguousarray(centre + unit @ axes.T)
            nodes = _nodes(readings.arrays, certainty, position, gain, linear)
            base = -0.5 * np.einsum("ki,ij,kj->k", position, information, position)
            if not np.isfinite(nodes.likelihood).any():
                return declined(
                    batch, "no node of the search grid lies on the map", levels=float(level)
                )
            beta, weight = _temper(nodes.likelihood, base, options.support)
            # nodes as far apart as the posterior is wide would miss it
            if beta == 1.0:
                break
            centre, axes = _next_grid(unit, weight, options.cut, centre, axes)
        figures = {
            "levels": float(level),
            "temper": beta,
            "effective_nodes": 1.0 / float((weight**2).sum()),
        }
        if beta < 1.0:
            return declined(batch, "the posterior is narrower than the finest grid", **figures)
        sample = np.concatenate([position, nodes.velocity], axis=1)
        mean = weight @ sample
        covariance = (sample - mean).T @ (weight[:, None] * (sample - mean))
        covariance[2:, 2:] += np.einsum("k,kij->ij", weight, nodes.spread)
        return publish_posterior(batch, mean, covariance, figures)


def _temper(likelihood: Array, base: Array, support: float) -> tuple[float, Array]:
    """Return the largest power beta <= 1 of the likelihood that leaves so many effective nodes,
    and the weights there."""

    # a node off the map stays off it at beta = 0, which fewer nodes on it than `support` end with
    on_map = np.isfinite(likelihood)
    log_likelihood = np.where(on_map, likelihood, 0.0)

    def weigh(beta: float) -> Array:
        log = np.where(on_map, base + beta * log_likelihood, -np.inf)
        weight = np.exp(log - log.max())
        return weight / weight.sum()

    weight = weigh(1.0)
    if (weight**2).sum() * support <= 1.0:
        return 1.0, weight
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = math.sqrt(low * high) if low > 0.0 else 0.1 * high
        weight = weigh(middle)
        if (weight**2).sum() * support <= 1.0:
            low = middle
        else:
            high = middle
    return low, weigh(low)


def _next_grid(
    unit: Array, weight: Array, cut: float, centre: Array, axes: Array
) -> tuple[Array, Array]:
    """Centre (2,) and half axes (2, 2) of the smallest grid over the nodes that carry weight,
    along that weight's own axes."""
    kept = weight > cut * weight.max()
    place, share = unit[kept], weight[kept] / weight[kept].sum()
    mean = share @ place
    moment = (place - mean).T @ (share[:, None] * (place - mean))
    _, vectors = np.linalg.eigh(moment)
    along = (place - mean) @ vectors
    step = 2.0 / (math.sqrt(len(unit)) - 1.0)
    low, high = along.min(axis=0) - step, along.max(axis=0) + step
    middle = mean + vectors @ (0.5 * (low + high))
    return centre + axes @ middle, axes @ (vectors * (0.5 * (high - low)))


class _Nodes(NamedTuple):
    """K nodes with velocity error and bias integrated out."""

    likelihood: Array
    """(K,) logarithm; -inf off the map."""
    velocity: Array
    """(K, 2) mean velocity error, m/s."""
    spread: Array
    """(K, 2, 2) its covariance."""


@kernel
def _nodes(
    readings: ReadingArrays, weight: Array, position: Array, gain: Array, linear: Array
) -> _Nodes:
    """Integrate velocity error and bias out at each position error (K, 2).

    With u = (velocity, bias) about its mean given the node, of covariance P = `linear` (3, 3),
    r(u) = r - D u: the likelihood of r alone is that of N(0, W^-1 + D P D'), by the 3 x 3 system
    (1 + P D'WD), W = diag(`weight`). The mean velocity of a node is `gain` (2, 2) times its
    position."""
    count = position.shape[0]
    nodes = _Nodes(np.empty(count), np.empty((count, 2)), np.empty((count, 2, 2)))
    xi = np.empty((count, 4))
    for s in range(count):
        for i in range(2):
            xi[s, i] = position[s, i]
            xi[s, 2 + i] = gain[i, 0] * position[s, 0] + gain[i, 1] * position[s, 1]
    total, b, C = _normal_equations(readings, weight, xi)
    S = np.empty((3, 3))
    for s in range(count):
        determinant = _posterior(linear, C[s], S)
        explained = 0.0
        for i in range(3):
            u = S[i, 0] * b[s, 0] + S[i, 1] * b[s, 1] + S[i, 2] * b[s, 2]
            explained += b[s, i] * u
            if i < 2:
                nodes.velocity[s, i] = xi[s, 2 + i] + u
                nodes.spread[s, i, 0], nodes.spread[s, i, 1] = S[i, 0], S[i, 1]
        nodes.likelihood[s] = -0.5 * (total[s] - explained) - 0.5 * math.log(determinant)
        if math.isnan(total[s]):
            nodes.likelihood[s] = -np.inf
            nodes.velocity[s] = 0.0
            nodes.spread[s] = 0.0
    return nodes


@kernel
def _normal_equations(
    readings: ReadingArrays, weight: Array, xi: Array
) -> tuple[Array, Array, Array]:
    """Return r'Wr (K,), D'Wr (K, 3) and D'WD (K, 3, 3) at errors xi (K, 4), with W =
    diag(`weight`)."""
    grid, latitude, longitude, radian, level, _, transition, jacobian = readings
    count = xi.shape[0]
    total, b, C = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3))
    d = np.ones(3)
    for s in range(count):
        x0, x1, x2, x3 = xi[s, 0], xi[s, 1], xi[s, 2], xi[s, 3]
        square = 0.0
        for t in range(level.shape[0]):
            f, g = transition[t], jacobian[t]
            north = f[0, 0] * x0 + f[0, 1] * x1 + f[0, 2] * x2 + f[0, 3] * x3
            east = f[1, 0] * x0 + f[1, 1] * x1 + f[1, 2] * x2 + f[1, 3] * x3
            value, by_lat, by_lon = value_and_gradient(
                grid, latitude[t] - north * radian[t, 0], longitude[t] - east * radian[t, 1]
            )
            expected = g[0] * x0 + g[1] * x1 + g[2] * x2 + g[3] * x3
            r = level[t] - value - expected
            slope_north, slope_east = by_lat * radian[t, 0], by_lon * radian[t, 1]
            for i in range(2):
                d[i] = g[2 + i] - slope_north * f[0, 2 + i] - slope_east * f[1, 2 + i]
            square += weight[t] * r * r
            for i in range(3):
                b[s, i] += weight[t] * d[i] * r
                for j in range(3):
                    C[s, i, j] += weight[t] * d[i] * d[j]
        total[s] = square
    return total, b, C


@kernel
def _posterior(P: Array, C: Array, S: Array) -> float:
    """Write the posterior covariance S = (1 + P C)^-1 P (3, 3), by adjugate; return the
    determinant of 1 + P C."""
    A = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            A[i, j] = 1.0 if i == j else 0.0
            for k in range(3):
                A[i, j] += P[i, k] * C[k, j]
    inverse = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            r1, r2, c1, c2 = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = A[r1, c1] * A[r2, c2] - A[r1, c2] * A[r2, c1]
    determinant = A[0, 0] * inverse[0, 0] + A[0, 1] * inverse[1, 0] + A[0, 2] * inverse[2, 0]
    for i in range(3):
        for j in range(3):
            S[i, j] = 0.0
            for k in range(3):
                S[i, j] += inverse[i, k] * P[k, j] / determinant
    return determinant
