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

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import Scans, publish_posterior
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

    def solve(self, batch: Batch, field_map: FieldMap, scans: Scans) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        options = self.options
        prior = batch.prior[:2, :2]
        gain = np.linalg.solve(prior, batch.prior[:2, 2:]).T
        linear = np.zeros((3, 3))
        linear[:2, :2] = batch.prior[2:, 2:] - gain @ batch.prior[:2, 2:]
        linear[2, 2] = self.noise.bias_sigma**2
        information = np.linalg.inv(prior)
        # the grid lies along the axes of what carries weight; at first, of the prior
        centre, axes = (
            np.zeros(2),
            np.asarray(np.linalg.cholesky(prior), dtype=np.float64) * options.extent,
        )
        side = np.linspace(-1.0, 1.0, options.nodes)
        unit = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
        for level in range(1, options.levels + 1):
            position = centre + unit @ axes.T
            likelihood, velocity, spread = _nodes(
                scans.grid, scans.latitude, scans.longitude, scans.radian, scans.level, scans.sigma**-2.0,
                scans.transition, scans.jacobian, position, gain, linear,
            )  # fmt: skip
            base = -0.5 * np.einsum("ki,ij,kj->k", position, information, position)
            if not np.isfinite(likelihood).any():
                return declined(
                    batch, "no node of the search grid lies on the map", levels=float(level)
                )
            beta, weight = _temper(likelihood, base, options.support)
            # nodes as far apart as their weights are wide would miss what lies between them
            if beta == 1.0:
                break
            centre, axes = _next_grid(
                unit, weight, options.cut, centre, axes, 2.0 / (options.nodes - 1)
            )
        figures = {
            "levels": float(level),
            "temper": beta,
            "effective_nodes": 1.0 / float((weight**2).sum()),
        }
        if beta < 1.0:
            return declined(batch, "the posterior is narrower than the finest grid", **figures)
        sample = np.concatenate([position, velocity], axis=1)
        mean = weight @ sample
        covariance = (sample - mean).T @ (weight[:, None] * (sample - mean))
        covariance[2:, 2:] += np.einsum("k,kij->ij", weight, spread)
        return publish_posterior(batch, mean, covariance, figures)


def _temper(likelihood: Array, base: Array, support: float) -> tuple[float, Array]:
    """Return the largest power beta <= 1 of the likelihood that leaves so many effective nodes,
    and the weights there."""

    def weigh(beta: float) -> Array:
        log = base + beta * np.where(np.isfinite(likelihood), likelihood, -np.inf)
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
    unit: Array, weight: Array, cut: float, centre: Array, axes: Array, step: float
) -> tuple[Array, Array]:
    """Centre (2,) and half axes (2, 2) of the smallest grid over the nodes that carry weight,
    along that weight's own axes."""
    kept = weight > cut * weight.max()
    place, share = unit[kept], weight[kept] / weight[kept].sum()
    mean = share @ place
    moment = (place - mean).T @ (share[:, None] * (place - mean))
    _, vectors = np.linalg.eigh(moment)
    along = (place - mean) @ vectors
    low, high = along.min(axis=0) - step, along.max(axis=0) + step
    middle = mean + vectors @ (0.5 * (low + high))
    return centre + axes @ middle, axes @ (vectors * (0.5 * (high - low)))


@kernel
def _nodes(
    grid: Grid,
    latitude: Array,
    longitude: Array,
    radian: Array,
    level: Array,
    weight: Array,
    transition: Array,
    jacobian: Array,
    position: Array,
    gain: Array,
    linear: Array,
) -> tuple[Array, Array, Array]:
    """Integrate velocity and bias out at each node.

    Returns the marginal log-likelihood (K,), the mean velocity error (K, 2) and its covariance (K,
    2, 2) there. -inf off the map.

    With u = (velocity, bias) about its mean given the node, r(u) = r - D u: the likelihood of r
    alone is that of N(0, W^-1 + D P D'), by the 3 x 3 system (1 + P D'WD)."""
    count = position.shape[0]
    out = np.empty(count)
    velocity = np.empty((count, 2))
    spread = np.empty((count, 2, 2))
    b = np.empty(3)
    C = np.empty((3, 3))
    d = np.empty(3)
    for s in range(count):
        x0, x1 = position[s, 0], position[s, 1]
        x2, x3 = gain[0, 0] * x0 + gain[0, 1] * x1, gain[1, 0] * x0 + gain[1, 1] * x1
        total = 0.0
        for i in range(3):
            b[i] = 0.0
            for j in range(3):
                C[i, j] = 0.0
        for t in range(level.shape[0]):
            f, g = transition[t], jacobian[t]
            north = f[0, 0] * x0 + f[0, 1] * x1 + f[0, 2] * x2 + f[0, 3] * x3
            east = f[1, 0] * x0 + f[1, 1] * x1 + f[1, 2] * x2 + f[1, 3] * x3
            value, by_lat, by_lon = value_and_gradient(
                grid,
                latitude[t] - north * radian[t, 0],
                longitude[t] - east * radian[t, 1],
            )
            r = level[t] - value - (g[0] * x0 + g[1] * x1 + g[2] * x2 + g[3] * x3)
            slope_north, slope_east = by_lat * radian[t, 0], by_lon * radian[t, 1]
            for i in range(2):
                d[i] = g[2 + i] - slope_north * f[0, 2 + i] - slope_east * f[1, 2 + i]
            d[2] = 1.0
            total += weight[t] * r * r
            for i in range(3):
                b[i] += weight[t] * d[i] * r
                for j in range(3):
                    C[i, j] += weight[t] * d[i] * d[j]
        # posterior covariance of u: S = (1 + P C)^-1 P, by adjugate
        A = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                A[i, j] = 1.0 if i == j else 0.0
                for k in range(3):
                    A[i, j] += linear[i, k] * C[k, j]
        inverse = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                r1, r2, c1, c2 = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
                inverse[i, j] = A[r1, c1] * A[r2, c2] - A[r1, c2] * A[r2, c1]
        determinant = A[0, 0] * inverse[0, 0] + A[0, 1] * inverse[1, 0] + A[0, 2] * inverse[2, 0]
        explained = 0.0
        for i in range(3):
            u = 0.0
            for j in range(3):
                S = 0.0
                for k in range(3):
                    S += inverse[i, k] * linear[k, j] / determinant
                u += S * b[j]
                if i < 2 and j < 2:
                    spread[s, i, j] = S
            explained += b[i] * u
            if i < 2:
                velocity[s, i] = (x2 if i == 0 else x3) + u
        out[s] = -0.5 * (total - explained) - 0.5 * math.log(determinant)
        if math.isnan(total):
            out[s] = -np.inf
            velocity[s, 0] = velocity[s, 1] = 0.0
            for i in range(2):
                for j in range(2):
                    spread[s, i, j] = 0.0
    return out, velocity, spread
