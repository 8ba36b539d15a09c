"""The steps of the paper's matcher by hand and against filterpy: the map lookup, the association,
the filter and smoother."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from isogal.maps.interpolation import Grid, values_at
from isogal.matching.paper.kalman import backward_smoother, constant_velocity, forward_filter
from isogal.matching.paper.map_lookup import lookup, search_window
from isogal.matching.paper.pda import association_weights, candidate_variance, combine

# a grid with steps of 0.001 rad and 1e5 metres per radian: 100 m cells, node (i, j) at (100 i, 100
# j) m
STEP, METRES, NODES = 1e-3, (1e5, 1e5), 41


def grid_of(function):
    side = 100.0 * np.arange(NODES)
    values = function(side[:, None], side[None, :]) + np.zeros((NODES, NODES))
    return Grid(values, NODES, 0.0, STEP, 0.0, STEP)


def look(grid, centre, window, reading, *, slope=(0.0, 0.0), spacing=np.inf, wanted=20):
    """Offsets, mismatches and gradients of the candidates about a centre (north, east m)."""
    place = (centre[0] / METRES[0], centre[1] / METRES[1])
    offset, gradient = lookup(grid, place, METRES, window, reading, slope, spacing, wanted)
    value = values_at(
        grid, place[0] + offset[:, 0] / METRES[0], place[1] + offset[:, 1] / METRES[1]
    )
    return offset, reading - (value - offset @ slope), gradient


def ellipse(north, east, minimum=1.0):
    """Window of the 1-sigma ellipse of a covariance of these variances, m²."""
    return search_window(np.diag([north, east]), 1.0, minimum, False)


def rectangle(north, east, minimum=1.0):
    return search_window(np.diag([north, east]), 1.0, minimum, True)


def test_ellipse_by_hand():
    # 3-sigma of 20 m north and 10 m east
    shape, half_width = search_window(np.diag([400.0, 100.0]), 9.0, 1.0, False)
    np.testing.assert_allclose(half_width, [60.0, 30.0])
    np.testing.assert_allclose(shape, np.diag([1 / 3600.0, 1 / 900.0]), atol=1e-18)


def test_a_rectangle_holds_the_corners_that_the_ellipse_leaves_out():
    grid, centre = grid_of(lambda n, e: 0.0 * n), (2000.0, 2000.0)
    around = look(grid, centre, ellipse(1e4, 1e4), 0.0)[0]
    box = look(grid, centre, rectangle(1e4, 1e4), 0.0)[0]
    assert sorted(map(tuple, np.rint(around))) == [
        (-100, 0),
        (0, -100),
        (0, 0),
        (0, 100),
        (100, 0),
    ]
    assert len(box) == 9


def test_nearest_values_on_a_slope_by_hand():
    # the value is the distance north in km: of the nodes at 1.9, 2.0, ... km, 2.04 is nearest to
    # 2.0, then 2.1
    grid, window = grid_of(lambda n, e: n / 1000.0), rectangle(1e6, 1.0, minimum=30.0)
    offset, mismatch, gradient = look(grid, (2000.0, 2000.0), window, 2.04, wanted=3)
    np.testing.assert_allclose(offset, [[0.0, 0.0], [100.0, 0.0], [-100.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(mismatch, [0.04, -0.06, 0.14], atol=1e-12)
    np.testing.assert_allclose(gradient, [[1e-3, 0.0]] * 3, atol=1e-12)


def test_one_reading_fits_both_flanks_of_a_hill():
    # value 100 - |n - 2000| / 10: 60 at 400 m on either side, Fig. 1 of the paper in one dimension
    grid = grid_of(lambda n, e: 100.0 - np.abs(n - 2000.0) / 10.0)
    window = ellipse(1e6, 1.0, minimum=30.0)
    offset, mismatch, _ = look(grid, (2000.0, 2000.0), window, 60.0, wanted=2)
    assert sorted(np.rint(offset[:, 0])) == [-400, 400]
    np.testing.assert_allclose(mismatch, 0.0, atol=1e-9)


def test_reduction_with_the_wrong_position_is_undone():
    # a flat map, but readings fall by 1 per 100 m that the navigator is too far north; so a point
    # 100 m north of it, where the navigator would be 100 m too far south, predicts 1 more
    grid, window = grid_of(lambda n, e: 0.0 * n), ellipse(9e4, 1.0, minimum=30.0)
    offset, _, gradient = look(grid, (2000.0, 2000.0), window, 2.0, slope=(-0.01, 0.0), wanted=1)
    np.testing.assert_allclose(offset, [[200.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(gradient, [[0.01, 0.0]], atol=1e-12)


def test_missing_and_outside_are_never_candidates():
    def with_hole(n, e):
        values = n / 1000.0 + 0.0 * e
        values[20, 20] = np.nan
        return values

    # the hole spoils the interpolation at all nodes whose 4 x 4 surroundings hold it
    hole, wide = grid_of(with_hole), ellipse(1e6, 1e6)
    offset, _, _ = look(hole, (2000.0, 2000.0), wide, 2.0, wanted=1000)
    assert np.abs(offset).max(axis=1).min() > 100.0
    assert look(hole, (-3000.0, 2000.0), wide, 2.0)[0].shape == (0, 2)
    slope, window = grid_of(lambda n, e: n), ellipse(9e4, 9e4)
    edge, _, _ = look(slope, (0.0, 0.0), window, 2.0, wanted=1000)
    assert edge.min() > 0.0  # the outermost nodes cannot be interpolated


@given(
    north=st.floats(900.0, 3100.0),
    east=st.floats(900.0, 3100.0),
    reading=st.floats(0.0, 5.0),
    nn=st.floats(1e3, 4e5),
    ee=st.floats(1e3, 4e5),
    correlation=st.floats(-0.9, 0.9),
    box=st.booleans(),
    wanted=st.integers(1, 30),
)
def test_equals_sorting_all_cells_of_the_window(
    north, east, reading, nn, ee, correlation, box, wanted
):
    grid = grid_of(lambda n, e: np.sin(n / 300.0) + np.cos(e / 211.0) + n * e / 4e6)
    covariance = np.array(
        [[nn, correlation * np.sqrt(nn * ee)], [correlation * np.sqrt(nn * ee), ee]]
    )
    window = search_window(covariance, 1.0, 60.0, box)
    offset, mismatch, _ = look(grid, (north, east), window, reading, wanted=wanted)
    i, j = np.meshgrid(np.arange(1, NODES - 1), np.arange(1, NODES - 1), indexing="ij")
    d = np.stack([100.0 * i - north, 100.0 * j - east], -1)
    inside = (np.abs(d) <= window.half_width).all(-1) & (
        np.einsum("...i,ij,...j->...", d, window.shape, d) <= 1.0
    )
    brute = np.sort(np.abs(reading - grid.values[i, j])[inside])[:wanted]
    np.testing.assert_allclose(np.abs(mismatch), brute, atol=1e-9)
    assert (np.abs(offset) <= window.half_width + 1e-6).all()


def test_weights_contain_the_density_of_unequal_variances():
    # N((1,1); 0, 1 I) = exp(-1) / 2pi and N((2,0); 0, 4 I) = exp(-1/2) / (2pi 4)
    weights = association_weights(
        np.array([[1.0, 1.0], [2.0, 0.0]]), np.zeros(2), np.array([1.0, 4.0])
    )
    p = np.array([np.exp(-1.0), np.exp(-0.5) / 4.0])
    np.testing.assert_allclose(weights, p / p.sum(), rtol=1e-15)


def test_mean_and_variance_by_hand():
    mean, variance = combine(
        np.array([[0.0, 10.0], [4.0, 20.0]]), np.array([0.75, 0.25]), np.array([100.0, 300.0])
    )
    np.testing.assert_allclose(mean, [1.0, 12.5])
    assert variance == pytest.approx(150.0)  # eq. s3-021: no spread of the candidates in it


def test_variance_of_a_candidate_by_hand():
    # 1 mGal on 2 mGal/km: 500 m; a lattice of 120 m adds 1200 m²; a flat map gives the limit,
    # never a division by zero
    variance = candidate_variance(
        1.0e-5, np.array([[1.2e-8, 1.6e-8], [0.0, 0.0], [1.0e-15, 0.0]]), 120.0, 1.0e6
    )
    np.testing.assert_allclose(variance, [250_000.0 + 1200.0, 1.0e6, 1.0e6])


SCANS = 12
H = np.eye(2, 4)


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(1)
    interval = rng.uniform(5.0, 15.0, SCANS - 1)
    F, Q = constant_velocity(interval, 1e-3)
    root = rng.normal(size=(4, 4)) * np.array([[100.0], [100.0], [0.5], [0.5]])
    spread = rng.normal(size=(SCANS, 2, 2))
    R = 1e4 * (spread @ spread.transpose(0, 2, 1) + np.eye(2))
    z = rng.normal(scale=200.0, size=(SCANS, 2)) + 220.0 * np.arange(SCANS)[:, None]
    z[4] = np.nan
    return np.array([0.0, 10.0, 20.0, 18.0]), root @ root.T, F, Q, H, z, R


def test_constant_velocity_by_hand():
    F, Q = constant_velocity(np.array([2.0]), 3.0)
    np.testing.assert_array_equal(F[0], [[1, 0, 2, 0], [0, 1, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(
        Q[0], 3.0 * np.array([[8 / 3, 0, 2, 0], [0, 8 / 3, 0, 2], [2, 0, 2, 0], [0, 2, 0, 2]])
    )


def test_two_steps_of_noise_are_one_long_step():
    F, Q = constant_velocity(np.array([4.0, 7.0, 11.0]), 0.2)
    np.testing.assert_allclose(F[1] @ Q[0] @ F[1].T + Q[1], Q[2], rtol=1e-14)


def test_equals_filterpy(problem):
    mean, covariance, F, Q, _, z, R = problem
    xs, Ps, xp, Pp = forward_filter(*problem)
    smooth, smooth_P = backward_smoother(xs, Ps, xp, Pp, F)

    reference = KalmanFilter(dim_x=4, dim_z=2)
    reference.x, reference.P, reference.H = mean[:, None].copy(), covariance.copy(), H
    means, covariances = [mean[:, None]], [covariance]
    for t in range(1, SCANS):
        reference.predict(F=F[t - 1], Q=Q[t - 1])
        if not np.isnan(z[t]).any():
            reference.update(z[t][:, None], R=R[t])
        means.append(reference.x.copy())
        covariances.append(reference.P.copy())
    np.testing.assert_allclose(xs, np.array(means)[..., 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(Ps, np.array(covariances), rtol=1e-9, atol=1e-9)
    # filterpy's smoother uses Fs[k + 1], Qs[k + 1] for the step from k to k + 1
    rts_mean, rts_P, _, _ = reference.rts_smoother(
        np.array(means), np.array(covariances), Fs=[np.eye(4), *F], Qs=[np.eye(4), *Q]
    )
    np.testing.assert_allclose(smooth, rts_mean[..., 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(smooth_P, rts_P, rtol=1e-9, atol=1e-9)
