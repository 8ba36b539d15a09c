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
from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import UsableReadings, publish_posterior
from isogal.matching.interfaces import Batch, Fix, declined

EXTENT = 4.5
"""Half-width of the first grid in 1-sigma of the prior."""
SUPPORT = 20.0
"""Effective nodes that a tempered likelihood must leave."""
CUT = 1e-5
"""Share of the heaviest node's weight below which nodes are left out of the next grid."""
LEVELS = 10
"""Grids at most."""


class PointMassOptions(BaseModel):
    """Options of `point-mass`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    nodes: int = Field(25, ge=9, le=501, description="nodes along a side")


class PointMass(Baseline[PointMassOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "point-mass"
    options_model = PointMassOptions

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        options = self.options
        prior = batch.prior[:2, :2]
        gain = np.asarray(np.linalg.solve(prior, batch.prior[:2, 2:]).T, np.float64)
        linear = np.zeros((3, 3))
        linear[:2, :2] = batch.prior[2:, 2:] - gain @ batch.prior[:2, 2:]
        linear[2, 2] = self.bias_sigma**2
        information = np.linalg.inv(prior)
        # the grid lies along the axes of the nodes that carry weight; at first, of the prior
        centre = np.zeros(2)
        axes = np.asarray(np.linalg.cholesky(prior), dtype=np.float64) * EXTENT
        side = np.linspace(-1.0, 1.0, options.nodes)
        unit = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
        for level in range(1, LEVELS + 1):
            position = centre + unit @ axes.T
            nodes = _nodes(readings, field_map, position, gain, linear)
            base = -0.5 * np.einsum("ki,ij,kj->k", position, information, position)
            if not np.isfinite(nodes.likelihood).any():
                return declined(
                    batch, "no node of the search grid lies on the map", levels=float(level)
                )
            beta, weight = _temper(nodes.likelihood, base)
            # nodes as far apart as the posterior is wide would miss it
            if beta == 1.0:
                break
            centre, axes = _next_grid(unit, weight, centre, axes)
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


def _temper(likelihood: Array, base: Array) -> tuple[float, Array]:
    """Return the largest power beta <= 1 of the likelihood that leaves so many effective nodes,
    and the weights there."""

    # a node off the map stays off it at beta = 0, which fewer nodes on it than `SUPPORT` end with
    on_map = np.isfinite(likelihood)
    log_likelihood = np.where(on_map, likelihood, 0.0)

    def weigh(beta: float) -> Array:
        log = np.where(on_map, base + beta * log_likelihood, -np.inf)
        weight = np.exp(log - log.max())
        return weight / weight.sum()

    weight = weigh(1.0)
    if (weight**2).sum() * SUPPORT <= 1.0:
        return 1.0, weight
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = math.sqrt(low * high) if low > 0.0 else 0.1 * high
        weight = weigh(middle)
        if (weight**2).sum() * SUPPORT <= 1.0:
            low = middle
        else:
            high = middle
    return low, weigh(low)


def _next_grid(unit: Array, weight: Array, centre: Array, axes: Array) -> tuple[Array, Array]:
    """Centre (2,) and half axes (2, 2) of the smallest grid over the nodes that carry weight,
    along that weight's own axes."""
    kept = weight > CUT * weight.max()
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


def _nodes(
    readings: UsableReadings, field_map: FieldMap, position: Array, gain: Array, linear: Array
) -> _Nodes:
    """Integrate velocity error and bias out at each position error (K, 2).

    With u = (velocity, bias) about its mean given the node, of covariance P = `linear` (3, 3),
    r(u) = r - D u: the likelihood of r alone is that of N(0, W^-1 + D P D'), by the 3 x 3 system
    (1 + P D'WD), W the inverse variances of the noise. The mean velocity of a node is `gain`
    (2, 2) times its position."""
    xi = np.concatenate([position, position @ gain.T], axis=1)
    weight = readings.sigma**-2.0
    r, slope = readings.linearise(field_map, xi)
    off = np.isnan(r).any(axis=0)
    r = np.where(off, 0.0, r)
    D = np.concatenate([-slope[..., 2:], np.ones((*r.shape, 1))], axis=-1)
    D[:, off] = 0.0
    b = np.einsum("t,tki,tk->ki", weight, D, r)
    left = np.eye(3) + linear @ np.einsum("t,tki,tkj->kij", weight, D, D)
    S = np.linalg.solve(left, np.broadcast_to(linear, left.shape))
    u = np.einsum("kij,kj->ki", S, b)
    log = -0.5 * (weight @ r**2 - (b * u).sum(axis=1)) - 0.5 * np.linalg.slogdet(left)[1]
    return _Nodes(np.where(off, -np.inf, log), xi[:, 2:] + u[:, :2], S[:, :2, :2])
