"""Simulated sensors of position and heading."""

import math

import numpy as np
import pytest

from helpers.aids import displacement, in_turns
from helpers.refusals import refusal
from isogal.inertial.rotations import matrix
from isogal.scenario import load_scenario
from isogal.sensors.heading_aid import declination, simulate_headings
from isogal.sensors.magnetometer import field_vector
from isogal.sensors.position_aid import simulate_positions


def test_a_position_is_that_of_its_arm_with_errors_as_large_as_told():
    """400 runs, sizes within 5 %: more than four standard deviations of such an estimate."""
    entry = "{sigma: 8, correlated_sigma: 6, lever_arm: [3, -1, 40]}"
    it, trajectory = in_turns(f"positions=[{entry}]")
    fixes = simulate_positions(it.true.positions[0], trajectory, it.seed, range(400))
    arm = matrix(trajectory.attitude[fixes.ends]) @ [3.0, -1.0, 40.0]
    error = displacement(fixes, trajectory) - arm
    np.testing.assert_allclose(error.std(axis=0).mean(axis=0), 10.0, rtol=0.05)
    np.testing.assert_allclose(error.mean(axis=(0, 1)), 0.0, atol=1.0)


@pytest.mark.parametrize("kind", ["antennas", "compass", "course"])
def test_a_heading_is_that_of_the_bow(kind):
    exact = "sigma: 1e-9, bias: 0, correlated_sigma: 0"
    it, trajectory = in_turns(f"headings=[{{kind: {kind}, {exact}}}]")
    aid, epoch = it.true.headings[0], it.magnetometer.epoch
    seen = simulate_headings(aid, trajectory, it.seed, [0], epoch)
    true = np.arctan2(*matrix(trajectory.attitude[seen.ends])[:, [1, 0], 0].T)
    # the declination near Melbourne is 11.9 degrees east (IGRF, 2025)
    east = math.radians(11.9) if kind == "compass" else 0.0
    off = np.remainder(seen.values[0] + east - true + math.pi, 2.0 * math.pi) - math.pi
    np.testing.assert_allclose(off, 0.0, atol=5e-3 if east else 1e-6)


def test_declination_between_points_of_the_grid():
    """Within a milliradian of the field at the place itself, at mid latitudes."""
    for latitude, longitude in ((-37.8, 144.7), (51.3, -0.2), (33.33, 179.9), (10.1, -179.8)):
        north, east, _ = field_vector([latitude], [longitude], 0.0, 2025.0)[0]
        there = declination(math.radians(latitude), math.radians(longitude), 2025.0)
        assert there == pytest.approx(math.atan2(east, north), abs=1e-3)


def test_the_truth_of_an_entry_is_its_own():
    it, _ = in_turns("positions=[{sigma: 8, truth: {sigma: 3x}}, {name: usbl}]")
    assert [one.sigma for one in it.true.positions] == [24.0, 10.0]
    assert it.true.informed.true == it.true  # not once more
    assert [one.sigma for one in it.positions] == [8.0, 10.0]


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ("positions=[{}, {}]", "two entries of one name"),
        ("velocities=[{name: a}]", "velocities.0.kind: must be a sensor"),
        ("heights=[{name: a}]", "heights.0: it and height must have a sensor"),
        ("positions=[{name: A b}]", "name"),
        ("positions=[{interval: 0.3}]", "positions.0.interval"),
        ("positions=[{available: [[5, 1]]}]", "s since the start with 0 <= from < to"),
        ("positions=[{truth: {interval: 5}}]", "cannot differ"),
        ("headings=[{kind: sextant}]", "kind"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(bad, says):
    with refusal(says):
        load_scenario(None, [bad])
