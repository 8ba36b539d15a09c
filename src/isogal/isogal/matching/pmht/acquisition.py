"""Coarse-to-fine search for the navigator over tens of kilometres.

The likelihood of a batch is evaluated on a grid of position errors over three 1-sigma of the
prior, with the residual covariance widened by what the map changes within a cell; cells that could
hold the navigator are divided and evaluated again, finer. What is left is described by tiles, a
Gaussian each: where the readings follow a contour for long the posterior is a curved ridge that no
single Gaussian fits, and the tiles are the hypotheses that the next batches decide between. The
cost is bounded by the number of cells.
"""

import math

import numpy as np

from isogal.arrays import Array
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.likelihood import BatchLikelihood


def acquire(
    likelihood: BatchLikelihood, mean: Array, covariance: Array, most: int
) -> tuple[Mixture, float, float, int] | None:
    """Return the posterior as a mixture of tiles, the log evidence, the best cell's misfit and how
    many cells were asked, or None where no cell lies on the map.

    Parameters
    ----------
    likelihood : BatchLikelihood
    mean, covariance : (4,), (4, 4) arrays
        Prior of the navigator's error.
    most : int
        Tiles at most, the heaviest.
    """
    share = search_share(likelihood)
    cells, size = _coarse_cells(covariance, share)
    finer = int(share * CONSTANTS.fine_cells) // 9
    # velocity is not searched: it goes with position as the prior has it; what is left of it bends
    # the track and offsets the reduction
    follow = np.asarray(
        np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T, dtype=np.float64
    )
    precision = np.linalg.inv(covariance[:2, :2])
    span = float(
        np.abs(likelihood.readings.transition[:, 0, 2]).max()
    )  # s, age of the oldest scan
    rest = covariance[2:, 2:] - follow @ covariance[:2, 2:]
    bend = span * math.sqrt(max(float(np.linalg.eigvalsh(rest)[-1]), 0.0)) / math.sqrt(12.0)
    slope = _typical_slope(likelihood, mean + _with_velocity(cells * size, follow))
    sigma = math.sqrt(float(np.diag(likelihood.covariance).mean()))
    finest = max(
        1.001 * CONSTANTS.finest_cell_m,
        math.sqrt(12.0) * CONSTANTS.fine_enough_sigma * sigma / max(slope, 1e-300),
    )
    asked = 0
    while True:
        asked += len(cells)
        place = cells * size
        blurred = likelihood.blurred(slope * math.hypot(size / math.sqrt(12.0), bend), rest)
        fitting = blurred.log(mean + _with_velocity(place, follow))
        value = fitting - 0.5 * np.einsum("si,ij,sj->s", place, precision, place)
        top = float(value.max())
        if not math.isfinite(top):
            return None
        keep = value > top - CONSTANTS.search_depth_log
        heaviest = np.argsort(-value[keep], kind="stable")
        given_up = np.exp(value[keep][heaviest[finer:]] - top).sum()
        # the navigator may be in a cell that there are too many of to divide
        if size <= finest or given_up > CONSTANTS.given_up_share * np.exp(value[keep] - top).sum():
            break
        cells, size = _divided(cells[keep][heaviest[:finer]]), size / 3.0
    weight = np.exp(value[keep] - top)
    normaliser = math.log(2.0 * math.pi) + 0.5 * float(np.linalg.slogdet(covariance[:2, :2])[1])
    evidence = top + math.log(float(weight.sum())) + 2.0 * math.log(size) - normaliser
    # the widened likelihood leaves out a smaller constant than the given one, which others are
    # compared by
    evidence += blurred.log_normaliser - likelihood.log_normaliser
    misfit = -2.0 * float(fitting[int(np.argmax(value))])
    tiles = _tiles(cells[keep], weight, size, mean, covariance, follow, most)
    return tiles, evidence, misfit, asked


def search_share(likelihood: BatchLikelihood) -> float:
    """Return how much of what a search may take is left to a batch of many readings."""
    return min(1.0, CONSTANTS.search_batch_readings / len(likelihood.rows))


def _divided(cells: Array) -> Array:
    """Return the nine cells (9 K, 2) of the next finer grid in each of some cells (K, 2)."""
    fan = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    return np.asarray((3 * cells[:, None] + fan).reshape(-1, 2))


def _coarse_cells(covariance: Array, share: float) -> tuple[Array, float]:
    """Return the row and column (K, 2) of the cells of the coarsest grid, counted from its middle,
    and their size, m: the finest size times a power of three. Of the cells that there may be they
    are a share."""
    reach = CONSTANTS.search_reach_sigma * np.sqrt(np.diag(covariance)[:2])
    most = share * CONSTANTS.coarse_cells
    size = max(CONSTANTS.finest_cell_m, math.sqrt(4.0 * reach[0] * reach[1] / most))
    size = CONSTANTS.finest_cell_m * 3.0 ** math.ceil(
        math.log(size / CONSTANTS.finest_cell_m, 3.0) - 1e-9
    )
    counts = np.ceil(reach / size).astype(int)
    rows, columns = np.arange(-counts[0], counts[0] + 1), np.arange(-counts[1], counts[1] + 1)
    return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2), size


def _with_velocity(place: Array, follow: Array) -> Array:
    return np.concatenate([place, place @ follow.T], axis=1)


def _typical_slope(likelihood: BatchLikelihood, xi: Array) -> float:
    """RMS gradient of the map (unit per m) over the search area, from some two hundred of the
    errors xi (S, 4).
    """
    squares = []
    for place in xi[:: max(1, len(xi) // 200)]:
        _, slope = likelihood.linearise(place)
        good = np.isfinite(slope[:, 0])
        squares.append((slope[good, :2] ** 2).sum(axis=1))
    flat = np.concatenate(squares)
    return math.sqrt(float(flat.mean())) if flat.size else 0.0


def _tiles(
    cells: Array,
    weight: Array,
    size: float,
    mean: Array,
    covariance: Array,
    follow: Array,
    most: int,
) -> Mixture:
    """Join cells to tiles and describe each by a Gaussian."""
    row, column = (cells // CONSTANTS.tile_cells).T
    key = (row - row.min()) * (np.ptp(column) + 1) + column - column.min()
    _, tile = np.unique(key, return_inverse=True)
    total = np.bincount(tile, weight)
    order = np.argsort(-total, kind="stable")[:most]
    rank = np.full(len(total), -1)
    rank[order] = np.arange(len(order))
    member = rank[tile] >= 0
    group, place = rank[tile[member]], cells[member] * size
    w = weight[member] / total[order][group]

    def summed(value: Array) -> Array:
        return np.asarray(np.bincount(group, w * value, len(order)), dtype=np.float64)

    centre = np.stack([summed(place[:, 0]), summed(place[:, 1])], axis=1)
    north, east = (place - centre[group]).T
    both = summed(north * east)
    spread = np.array([[summed(north**2), both], [both, summed(east**2)]]).transpose(2, 0, 1)
    spread += np.eye(2) * size**2 / 6.0
    along = spread @ follow.T
    rest = covariance[2:, 2:] - follow @ covariance[:2, 2:]
    covariances = np.empty((len(order), 4, 4))
    covariances[:, :2, :2] = spread
    covariances[:, :2, 2:] = along
    covariances[:, 2:, :2] = along.transpose(0, 2, 1)
    covariances[:, 2:, 2:] = rest + follow @ along
    means = mean + np.concatenate([centre, centre @ follow.T], axis=1)
    return Mixture(total[order] / total[order].sum(), means, covariances)
