"""Quaternions against scipy's rotations (rotation vectors: tests/fusion/test_against_numpy.py)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from isogal.inertial.rotations import (
    SMALL,
    from_angles,
    from_heading,
    from_matrix,
    from_rotation_vector,
    from_short_rotation_vector,
    matrix,
    multiply,
    rotate,
    to_angles,
    to_rotation_vector,
    to_small_rotation_vector,
)

seeds = st.integers(0, 2**32 - 1)


def quaternion(rotation: Rotation) -> np.ndarray:
    return rotation.as_quat(scalar_first=True)


@given(seeds)
def test_product_rotation_and_matrix_equal_scipy(seed):
    random = np.random.default_rng(seed)
    a, b = Rotation.random(2, random)
    vector = random.normal(0.0, 10.0, 3)
    product = np.array(multiply(*quaternion(a), *quaternion(b)))
    expected = quaternion(a * b)
    np.testing.assert_allclose(product, expected * np.sign(expected @ product), atol=1e-15)
    np.testing.assert_allclose(rotate(*quaternion(a), *vector), a.apply(vector), atol=1e-13)
    np.testing.assert_allclose(matrix(quaternion(a)), a.as_matrix(), atol=1e-15)


@given(seeds)
def test_quaternion_of_a_matrix(seed):
    rotation = Rotation.random(random_state=np.random.default_rng(seed))
    found, expected = from_matrix(rotation.as_matrix()), quaternion(rotation)
    np.testing.assert_allclose(found, expected * np.sign(expected @ found), atol=1e-15)


@pytest.mark.parametrize("axis", range(3))
def test_quaternion_of_half_a_turn(axis):
    """The first component is zero, so that another is the largest."""
    expected = np.eye(4)[1 + axis]
    found = from_matrix(matrix(expected))
    np.testing.assert_allclose(np.abs(found), expected, atol=1e-15)


@pytest.mark.parametrize("heading_deg", [-90.0, 0.0, 57.0, 180.0, 300.0])
def test_heading_is_clockwise_from_north(heading_deg):
    heading = np.radians(heading_deg)
    attitude = from_heading(heading)
    np.testing.assert_allclose(
        rotate(*attitude, 1.0, 0.0, 0.0), [np.cos(heading), np.sin(heading), 0.0], atol=1e-15
    )
    np.testing.assert_allclose(rotate(*attitude, 0.0, 0.0, 1.0), [0.0, 0.0, 1.0], atol=1e-15)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_roll_pitch_and_heading_equal_scipy(roll, pitch, heading):
    expected = quaternion(Rotation.from_euler("ZYX", [heading, pitch, roll]))
    found = from_angles(roll, pitch, heading)
    np.testing.assert_allclose(found * np.sign(expected @ found), expected, atol=1e-15)
    np.testing.assert_allclose(to_angles(matrix(found)), [roll, pitch, heading], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 0.1999, 2 * np.arcsin(np.sqrt(SMALL)) - 1e-9, 3.14])
def test_series_equal_the_general_functions(angle):
    axis = np.array([0.36, -0.48, 0.8])
    np.testing.assert_allclose(
        from_short_rotation_vector(*(axis * angle)),
        from_rotation_vector(*(axis * angle)),
        atol=1e-15,
    )
    w, x, y, z = from_rotation_vector(*(axis * angle))
    if x * x + y * y + z * z <= SMALL:
        np.testing.assert_allclose(
            to_small_rotation_vector(x, y, z), axis * angle, rtol=1e-14, atol=1e-30
        )
    np.testing.assert_allclose(
        to_rotation_vector(-w, -x, -y, -z), axis * angle, rtol=1e-13, atol=1e-30
    )


def test_the_matrix_of_one_quaternion_is_that_among_others():
    quaternions = np.array([[0.5, -0.5, 0.5, 0.5], [0.6, 0.0, 0.8, 0.0]])
    for one, among_others in zip(quaternions, matrix(quaternions), strict=True):
        np.testing.assert_array_equal(matrix(one), among_others)
