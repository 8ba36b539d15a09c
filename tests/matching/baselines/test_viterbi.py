"""The trellis against an enumeration of all paths."""

import itertools

import numpy as np

from helpers.batches import make_batch
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching.baselines.readings import ReadingArrays, UsableReadings
from isogal.matching.baselines.viterbi import Viterbi, _emissions, _trellis


def test_trellis_equals_trying_all_paths():
    rng = np.random.default_rng(4)
    cells, scans, sigma, drift = 3, 4, 0.4, (0.3, 0.2)
    nodes = 0.05 * rng.standard_normal((12, 12)).cumsum(0).cumsum(1)
    grid = Grid(nodes, 12, 0.0, 1e-3, 0.0, 1e-3)
    side = np.array([-120.0, 0.0, 120.0])
    radian = np.full((scans, 2), 1e-5)
    latitude, longitude = 5e-3 + 3e-4 * np.arange(scans), np.full(scans, 6e-3)
    level = rng.standard_normal(scans)
    jacobian = 1e-3 * rng.standard_normal((scans, 4))
    start = -0.5 * (side[:, None] ** 2 + side[None, :] ** 2) / 100.0**2
    noise = np.full(scans, sigma)
    transition = np.zeros((scans, 2, 4))
    arrays = ReadingArrays(grid, latitude, longitude, radian, level, noise, transition, jacobian)
    readings = UsableReadings(arrays, np.arange(scans))
    place = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1)
    path, marginal = _trellis(_emissions(readings, place, 120.0, noise**2), start, drift)

    places = list(itertools.product(range(cells), range(cells)))
    emission = np.zeros((scans, cells, cells))
    for t, (i, j) in itertools.product(range(scans), places):
        value, by_lat, by_lon = value_and_gradient(
            grid, latitude[t] - side[i] * radian[t, 0], longitude[t] - side[j] * radian[t, 1]
        )
        slope = np.array([by_lat * radian[t, 0], by_lon * radian[t, 1]]) - jacobian[t, :2]
        variance = sigma**2 + 120.0**2 / 12.0 * slope @ slope
        residual = level[t] - value - jacobian[t, :2] @ [side[i], side[j]]
        emission[t, i, j] = np.exp(-0.5 * residual**2 / variance) / np.sqrt(variance)
    step = [[0.5 * d, 1.0 - d, 0.5 * d] for d in drift]
    best, best_path, total = 0.0, None, np.zeros((cells, cells))
    for candidate in itertools.product(places, repeat=scans):
        p = np.exp(start[candidate[0]]) * np.prod(
            [emission[(t, *place)] for t, place in enumerate(candidate)]
        )
        for (a, b), (c, d) in itertools.pairwise(candidate):
            p *= (
                0.0 if max(abs(a - c), abs(b - d)) > 1 else step[0][c - a + 1] * step[1][d - b + 1]
            )
        total[candidate[-1]] += p
        if p > best:
            best, best_path = p, candidate
    assert [tuple(place) for place in path] == list(best_path)
    np.testing.assert_allclose(marginal, total / total.sum(), rtol=1e-9)


def test_the_path_is_listed(rough_map):
    batch, truth = make_batch(rough_map, (100.0, -80.0, 0.02, 0.0), prior_sigma=(150.0, 0.03))
    fix, _ = Viterbi().match(batch, rough_map, None)
    assert list(fix.candidates.scan) == list(range(30))
    cell = fix.diagnostics["cell"]
    assert np.hypot(*truth.error_of(fix)) < 4.0 * cell
    assert fix.information is None


def test_a_path_at_the_edge_is_no_fix(rough_map):
    batch, _ = make_batch(rough_map, (900.0, 900.0, 0.0, 0.0), prior_sigma=(100.0, 0.02))
    fix, _ = Viterbi().match(batch, rough_map, None)
    assert fix.reason == "the most probable path ends at the edge of the search grid"
