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
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import value_and_gradient
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import ReadingArrays, UsableReadings, publish_posterior
from isogal.matching.interfaces import Batch, Candidates, Fix, declined


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
        arrays = readings.arrays
        first = arrays.transition[0] @ batch.prior @ arrays.transition[0].T
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
        common = readings.velocity_variance(batch.prior[2:, 2:]) + self.noise.bias_sigma**2
        variance = arrays.sigma**2 + len(batch) * common
        path, marginal = _trellis(arrays, variance, side, start, (float(step[0]), float(step[1])))
        if path[-1, 0] < 0:
            return declined(batch, "no cell of the search grid lies on the map")
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
            _listed(readings, place[path[:, 0], path[:, 1]]),
            position_only=True,
            least_gain=0.02,
        )


def _listed(readings: UsableReadings, error: Array) -> Candidates:
    """Return the places of a path of position errors (N, 2) m."""
    arrays = readings.arrays
    return Candidates(
        latitude=arrays.latitude - error[:, 0] * arrays.radian[:, 0],
        longitude=arrays.longitude - error[:, 1] * arrays.radian[:, 1],
        weight=np.ones(len(readings)),
        scan=readings.row,
    )


def _with_velocity(prior: Array, position: Array, covariance: Array) -> tuple[Array, Array]:
    """Posterior of xi where only its position has been measured: the velocity follows by
    regression."""
    gain = np.linalg.solve(prior[:2, :2], prior[:2, :]).T
    return gain @ position, prior + gain @ (covariance - prior[:2, :2]) @ gain.T


@kernel
def _emissions(
    readings: ReadingArrays, t: int, variance: float, side: Array, emission: Array
) -> float:
    """Write the log-likelihood (n, n) of one reading in each cell, -inf off the map; return the
    largest."""
    grid, level = readings.grid, readings.level[t]
    latitude, longitude, radian = readings.latitude[t], readings.longitude[t], readings.radian[t]
    jacobian = readings.jacobian[t]
    cell = side[1] - side[0]
    largest = -np.inf
    for i in range(side.shape[0]):
        for j in range(side.shape[0]):
            value, by_lat, by_lon = value_and_gradient(
                grid, latitude - side[i] * radian[0], longitude - side[j] * radian[1]
            )
            slope_north = by_lat * radian[0] - jacobian[0]
            slope_east = by_lon * radian[1] - jacobian[1]
            total = variance + cell * cell / 12.0 * (
                slope_north * slope_north + slope_east * slope_east
            )
            r = level - value - jacobian[0] * side[i] - jacobian[1] * side[j]
            emission[i, j] = (
                -np.inf if math.isnan(r) else -0.5 * r * r / total - 0.5 * math.log(total)
            )
            largest = max(largest, emission[i, j])
    return largest


@kernel
def _steps(variance: tuple[float, float]) -> Array:
    """Probabilities (3, 3) of a step to each of the cells around, from its variance north and
    east, cells²: a step of one cell either way has half of that as probability."""
    move = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            share = 0.5 * variance[0] if i != 1 else 1.0 - variance[0]
            move[i, j] = share * (0.5 * variance[1] if j != 1 else 1.0 - variance[1])
    return move


@kernel
def _trellis(
    readings: ReadingArrays,
    variance: Array,
    side: Array,
    start: Array,
    step: tuple[float, float],
) -> tuple[Integers, Array]:
    """Run both algorithms: the best path (N, 2) in cells (-1 = none) and the marginal probability
    (n, n) at the last scan.

    `variance` (N,) is the readings' noise, `start` the log-prior (n, n) at the first scan, `step`
    the variance of a step north and east, in cells²."""
    scans, n = readings.level.shape[0], side.shape[0]
    move = _steps(step)
    log_move = np.full((3, 3), -np.inf)
    for i in range(3):
        for j in range(3):
            if move[i, j] > 0.0:
                log_move[i, j] = math.log(move[i, j])
    best, new_best = np.empty((n, n)), np.empty((n, n))
    forward, new_forward = np.empty((n, n)), np.empty((n, n))
    emission = np.empty((n, n))
    back = np.zeros((scans, n, n), np.int8)
    path = np.full((scans, 2), -1)
    for t in range(scans):
        largest = _emissions(readings, t, variance[t], side, emission)
        if largest == -np.inf:
            return path, forward
        total = 0.0
        top = -np.inf
        for i in range(n):
            for j in range(n):
                if t == 0:
                    score, mass = start[i, j], math.exp(start[i, j])
                else:
                    score, mass = -np.inf, 0.0
                    for a in range(max(0, i - 1), min(n, i + 2)):
                        for b in range(max(0, j - 1), min(n, j + 2)):
                            mass += move[a - i + 1, b - j + 1] * forward[a, b]
                            reached = best[a, b] + log_move[a - i + 1, b - j + 1]
                            if reached > score:
                                score = reached
                                back[t, i, j] = 3 * (a - i + 1) + (b - j + 1)
                new_best[i, j] = score + emission[i, j]
                new_forward[i, j] = mass * math.exp(emission[i, j] - largest)
                total += new_forward[i, j]
                top = max(top, new_best[i, j])
        for i in range(n):
            for j in range(n):
                best[i, j] = new_best[i, j] - top
                forward[i, j] = new_forward[i, j] / total if total > 0.0 else 1.0 / (n * n)
    i = j = 0
    for a in range(n):
        for b in range(n):
            if best[a, b] > best[i, j]:
                i, j = a, b
    for t in range(scans - 1, -1, -1):
        path[t, 0], path[t, 1] = i, j
        i, j = i + back[t, i, j] // 3 - 1, j + back[t, i, j] % 3 - 1
    return path, forward
