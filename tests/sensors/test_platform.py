"""A gravimeter's platform that is not level."""

import numpy as np
import pytest

from isogal.inertial.rotations import from_rotation_vector, matrix
from isogal.scenario import Gravimeter, Scenario
from isogal.sensors.platform import levelling_error, tilted_reading
from isogal.sensors.trajectory import build_trajectory


def errors_of(runs, **keys):
    trajectory = build_trajectory(Scenario(route={"duration": 6000.0}))
    index = np.arange(10, len(trajectory) + 1, 10)
    return np.stack(
        [levelling_error(Gravimeter(**keys), 3, run, trajectory, index) for run in runs]
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


def test_it_reads_too_little_by_g_times_the_variance():
    """E(theta_n² + theta_e²) / 2 = sigma²; 40 runs of 6000 s, correlated over 300 s / 2."""
    error = errors_of(range(40), platform_tilt=2e-3)
    assert error.mean() == pytest.approx(-9.8 * 4e-6, rel=0.15)
    assert errors_of(range(40), platform_tilt=4e-3).mean() == pytest.approx(
        4.0 * error.mean(), rel=0.05
    )


def test_a_run_does_not_depend_on_others():
    np.testing.assert_array_equal(
        errors_of([4, 7], platform_tilt=1e-3)[1], errors_of([7], platform_tilt=1e-3)[0]
    )
