"""`viterbi`: the most probable path through cells of position error, a hidden Markov model.

Sources: Enns & Morrell (1995), "Terrain-aided navigation using the Viterbi algorithm", J.
Guidance, Control, and Dynamics 18(6):1444-1449; Forney (1973), "The Viterbi algorithm", Proc. IEEE
61(3):268-278.

Hidden state: the cell of a square grid in which the navigator's position error lies; it may step
to any of the eight cells around it at each scan, a random walk that widens the prior over the
batch as the navigator's own covariance does. Emission: the reading, with what the map changes
within a cell added to its noise. The fix is the last cell of the most probable path; a path that
ends at the grid's edge gives none. The covariance comes from the same trellis, summed over paths
instead of maximised (the forward algorithm; Rabiner 1989, Proc. IEEE 77(2):257-286), about that
cell."""

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array, Integers
from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import UsableReadings, publish_posterior
from isogal.matching.interfaces import Batch, Fix, declined


class ViterbiOptions(BaseModel):
    """Options of `viterbi`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    cells: int = Field(31, ge=5, le=501, description="cells along a side")
    extent: float = Field(
        3.5, gt=0.0, description="half-width of the grid in 1-sigma of the navigator's position"
    )


class Viterbi(Baseline[ViterbiOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "viterbi"
    options_model = ViterbiOptions

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        first = readings.transition[0] @ batch.prior @ readings.transition[0].T
        widest = max(float(np.diag(first).max()), float(np.diag(batch.prior)[:2].max()))
        cell = 2.0 * self.options.extent * math.sqrt(widest) / self.options.cells
        side = cell * (np.arange(self.options.cells) - 0.5 * (self.options.cells - 1))
        place = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1)
        start = -0.5 * np.einsum("ijk,kl,ijl->ij", place, np.linalg.inv(first), place)
        # steps that widen the first scan's prior to the batch end's: the error grows along its
        # velocity error, not at random
        grown = np.maximum(np.diag(batch.prior)[:2] - np.diag(first), 0.0)
        step = np.minimum(grown / max(len(readings) - 1, 1) / cell**2, 1.0)
        # a wrong velocity's Eötvös term and a bias are the same at all scans; as white noise of T
        # times the variance they weigh as much
        common = readings.velocity_variance(batch.prior[2:, 2:]) + self.bias_sigma**2
        variance = readings.sigma**2 + len(batch) * common
        found = _trellis(_emissions(readings, place, cell, variance), start, tuple(step))
        if found is None:
            return declined(batch, "no cell of the search grid lies on the map")
        path, marginal = found
        if path[-1].min() == 0 or path[-1].max() == self.options.cells - 1:
            return declined(
                batch, "the most probable path ends at the edge of the search grid", cell=cell
            )
        last = place[path[-1, 0], path[-1, 1]]
        away = place - last
        covariance = np.einsum("ij,ijk,ijl->kl", marginal, away, away) + cell**2 / 12.0 * np.eye(2)
        figures = {"cell": cell, "probability": float(marginal[path[-1, 0], path[-1, 1]])}
        return publish_posterior(
            batch,
            *_with_velocity(batch.prior, last, covariance),
            figures,
            readings.places(place[path[:, 0], path[:, 1]]),
            position_only=True,
            least_gain=0.02,
        )


def _with_velocity(prior: Array, position: Array, covariance: Array) -> tuple[Array, Array]:
    """Posterior of xi where only its position has been measured: the velocity follows by
    regression."""
    gain = np.linalg.solve(prior[:2, :2], prior[:2, :]).T
    return gain @ position, prior + gain @ (covariance - prior[:2, :2]) @ gain.T


def _emissions(readings: UsableReadings, place: Array, cell: float, variance: Array) -> Array:
    """Return (N, n, n) the log-likelihoods of readings with noise (N,) in cells of a size (m) at
    position errors (n, n, 2); -inf off the map."""
    jacobian = readings.jacobian[:, None, None, :2]
    difference, *slope = readings.compared(np.broadcast_to(place, (len(readings), *place.shape)))
    within = ((np.stack(slope, axis=-1) - jacobian) ** 2).sum(axis=-1)
    total = variance[:, None, None] + cell**2 / 12.0 * within
    residual = difference - (jacobian * place).sum(axis=-1)
    log = -0.5 * residual**2 / total - 0.5 * np.log(total)
    return np.where(np.isnan(residual), -np.inf, log)


def _trellis(
    emission: Array, start: Array, step: tuple[float, float]
) -> tuple[Integers, Array] | None:
    """Run both algorithms: the best path (N, 2) in cells and the marginal probability (n, n) at
    the last scan; None where a scan has no cell on the map.

    Parameters
    ----------
    emission : (N, n, n) array
        Log-likelihoods.
    start : (n, n) array
        Log-prior at the first scan.
    step : (float, float)
        Variance of a step north and east, cells²: one cell either way has half of that as
        probability.
    """
    if (emission.max(axis=(1, 2)) == -np.inf).any():
        return None
    move = np.multiply.outer(*(np.array([0.5 * s, 1.0 - s, 0.5 * s]) for s in step)).ravel()
    with np.errstate(divide="ignore"):
        log_move = np.log(move)
    back, best, forward = np.zeros(emission.shape, int), start, np.exp(start)
    for t, log in enumerate(emission):
        if t > 0:
            reached = _around(best, -np.inf) + log_move
            back[t], best = reached.argmax(axis=-1), reached.max(axis=-1)
            forward = _around(forward, 0.0) @ move
        best = best + log
        best = best - best.max()
        forward = forward * np.exp(log - log.max())
        total = forward.sum()
        forward = forward / total if total > 0.0 else np.full(start.shape, 1.0 / start.size)
    cell = np.array(np.unravel_index(int(best.argmax()), start.shape))
    path = np.empty((len(emission), 2), int)
    for t in range(len(emission) - 1, -1, -1):
        path[t] = cell
        cell = cell + np.divmod(back[t, cell[0], cell[1]], 3) - 1
    return path, forward


def _around(cells: Array, outside: float) -> Array:
    """Return (n, n, 9) what the cells around each one have, itself included, row by row."""
    wide = np.pad(cells, 1, constant_values=outside)
    return sliding_window_view(wide, (3, 3)).reshape(*cells.shape, 9)
