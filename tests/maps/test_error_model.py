"""Map errors without kinks along a track, and of the tensor's components that come from one
potential: covariance against Fourier transforms of a grid and against drawn fields."""

from functools import partial

import numpy as np
import pytest

from isogal.fields.map_error import TrueMapError
from isogal.maps.error_model import displacements, smooth, tensor_covariance
from isogal.maps.potential import COMPONENTS, operator
from isogal.maps.spectral import waves_of
from isogal.scenario import validate_scenario
from isogal.sensors.trajectory import build_trajectory

LENGTH = 800.0


def covariance(apart, components=COMPONENTS, length=LENGTH):
    """(C, C) of two places."""
    count = len(components)
    channel = np.tile(np.arange(count), 2)
    vector = np.array(apart, dtype=float)
    both = np.zeros((2 * count, 2 * count, 2))
    both[:count, count:], both[count:, :count] = vector, -vector
    return tensor_covariance(components, channel, both, length)[:count, count:]


def on_a_torus(nodes=256, cells_per_length=6):
    """Covariances (C, C, nodes, nodes) of all pairs, by Fourier transform of the spectrum times
    what `gradients` multiplies a map's waves by; places are cells apart."""
    cell = LENGTH / cells_per_length
    waves = waves_of((nodes, nodes), (cell, cell))
    axis = cell * nodes * np.fft.fftfreq(nodes)
    spectrum = np.fft.rfft2(np.exp(-np.hypot(axis[:, None], axis) / LENGTH)).real
    size = np.where(waves.size > 0.0, waves.size, 1.0)
    factors = [partial(operator, name, 0.0)(waves) / size for name in COMPONENTS]
    return cell, {
        (i, j): np.fft.irfft2(spectrum * np.conj(a) * b, (nodes, nodes))
        for i, a in enumerate(factors)
        for j, b in enumerate(factors)
    }


def test_it_is_the_inverse_transform_of_the_spectrum():
    cell, found = on_a_torus()
    for north, east in ((0, 0), (4, 0), (0, -7), (5, 9), (-12, 6), (-3, -20)):
        expected = covariance((north * cell, east * cell))
        here = np.array([[found[i, j][north, east] for j in range(6)] for i in range(6)])
        # the grid has no wave shorter than two cells, nor any longer than itself
        np.testing.assert_allclose(here, expected, atol=0.012)
        assert np.abs(expected).max() > 0.02


def test_drawn_fields_have_this_covariance():
    """Along a route with a corner. Of 400 runs an element errs by 1-sigma 0.05 of the product of
    two 1-sigmas, and none of the 2,000 by 5.5 of that."""
    corner = [(-37.0, 145.0, 30), (-36.98, 145.01, 30), (-36.99, 145.04, 30)]
    settings = validate_scenario({
        "field": "gradient",
        "gradiometer": {"components": COMPONENTS[1:], "map_errors": "one_potential"},
        "map_error": {"sigma": 2e-9, "correlation_length": LENGTH},
        "route": {"waypoints": corner, "duration": 150.0},
        "gravimeter": {"interval": 15.0},
    })  # fmt: skip
    trajectory = build_trajectory(settings)
    index = np.arange(15, len(trajectory), 15)
    drawn = TrueMapError(settings, trajectory, index, range(400)).of_one_potential()
    assert drawn.shape == (400, len(index), 5)
    flat = drawn.reshape(400, -1) / 2e-9
    rows = np.repeat(index, 5)
    apart = displacements(trajectory.latitude[rows], trajectory.longitude[rows])
    expected = tensor_covariance(COMPONENTS[1:], np.tile(np.arange(5), len(index)), apart, LENGTH)
    scale = np.sqrt(np.diag(expected))
    off = np.abs(flat.T @ flat / 400 - expected) / np.outer(scale, scale)
    assert off.max() < 0.275
    # and on the mean over elements there is no difference
    assert off.mean() < 0.05
    alone = TrueMapError(settings, trajectory, index, [3]).of_one_potential()
    np.testing.assert_array_equal(alone[0], drawn[3])


def test_an_error_without_kinks_and_its_slope_are_a_markov_process():
    """What two distances do is what their sum does; both keep their variance."""
    steps, joined = smooth(np.array([300.0, 450.0, 750.0, 1200.0]), 1200.0)
    np.testing.assert_allclose(steps[1] @ steps[0], steps[2], rtol=1e-12)
    np.testing.assert_allclose(
        steps[1] @ joined[0] @ steps[1].T + joined[1], joined[2], rtol=1e-12
    )
    np.testing.assert_allclose(steps @ steps.swapaxes(1, 2) + joined, [np.eye(2)] * 4)
    assert (np.linalg.eigvalsh(joined) > 0.0).all()
    assert steps[3, 0, 0] == pytest.approx(np.exp(-1.0), rel=1e-5)
    # where it is nearly the same, it departs by the square of the distance
    near, _ = smooth(np.array([1.0, 2.0]), 1200.0)
    assert (1.0 - near[1, 0, 0]) / (1.0 - near[0, 0, 0]) == pytest.approx(4.0, rel=0.01)
