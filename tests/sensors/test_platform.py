"""A gravimeter's platform that is not level."""

import numpy as np
import pytest

from helpers.batches import noise_covariance
from isogal.inertial.rotations import from_rotation_vector, matrix
from isogal.matching.reading_noise import joined, noise_states
from isogal.scenario import Gravimeter, Scenario
from isogal.sensors.noise import RunScans
from isogal.sensors.platform import levelling_error, mean_error, tilted_reading
from isogal.sensors.trajectory import build_trajectory


def errors_of(runs, **keys):
    trajectory = build_trajectory(Scenario(route={"duration": 6000.0}))
    index = np.arange(10, len(trajectory) + 1, 10)
    return np.stack(
        [levelling_error(Gravimeter(**keys), RunScans(3, run, trajectory, index)) for run in runs]
    )


def test_a_level_platform_adds_nothing():
    assert not errors_of([0]).any()
    force = np.array([[0.3, -0.2, -9.8]])
    assert tilted_reading(force, np.zeros(1), np.zeros(1)) == pytest.approx([9.8])


def test_it_is_the_force_along_the_turned_axis():
    force, tilt = np.array([0.3, -0.2, -9.8]), np.array([2e-3, -3e-3, 0.0])
    turned = matrix(np.array(from_rotation_vector(*tilt)))
    expected = -float(force @ turned[:, 2])
    got = tilted_reading(force[None], tilt[:1], tilt[1:2])
    assert got[0] == pytest.approx(expected, abs=1e-8)  # third order in the tilt
    assert abs(expected - 9.8) > 4e-4


def test_its_mean_and_covariance_are_those_that_the_matcher_assumes():
    """60 runs of 6000 s, correlated over 150 s, so of some 1200 independent values; for a
    chi-square the standard error of a variance is 8 % then."""
    settings = Gravimeter(platform_tilt=2e-3)
    error = errors_of(range(60), platform_tilt=2e-3)
    assert error.mean() == pytest.approx(mean_error(settings), rel=0.15)
    time, level = 10.0 * np.arange(60), np.tile([17.0, 13.0], (60, 1))
    assumed = noise_covariance(joined(noise_states(settings, time, level)), np.zeros(60), time)
    apart = error - mean_error(settings)
    for lag in (0, 1, 15, 30):
        measured = (apart[:, : apart.shape[1] - lag] * apart[:, lag:]).mean()
        assert measured == pytest.approx(assumed[0, lag], abs=0.25 * assumed[0, 0]), lag


def test_in_a_turn_it_takes_horizontal_force():
    settings, time = Gravimeter(platform_tilt=2e-3, platform_time=300.0), 10.0 * np.arange(4)
    velocity = np.outer(time, [0.2, -0.1])
    still, moving = (
        noise_covariance(joined(noise_states(settings, time, v)), np.zeros(4), time)
        for v in (0.0 * velocity, velocity)
    )
    expected = 4e-6 * 0.05 * np.exp(-np.abs(time[:, None] - time) / 300.0)
    np.testing.assert_allclose(moving - still, expected, rtol=1e-9)
