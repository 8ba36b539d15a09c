"""Quaternions against scipy's rotations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
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

axes = st.floats(-1.0, 1.0)


def assert_is(found, rotation: Rotation, atol: float = 1e-15) -> None:
    """Whether a quaternion, of either sign, is a rotation of scipy's."""
    expected = rotation.as_quat(scalar_first=True)
    np.testing.assert_allclose(found, expected * np.sign(expected @ found), atol=atol)


@given(st.integers(0, 2**32 - 1))
def test_products_vectors_and_matrices_equal_scipy(seed):
    random = np.random.default_rng(seed)
    rotations = Rotation.random(2, random)
    a, b = rotations.as_quat(scalar_first=True)
    vector = random.normal(0.0, 10.0, 3)
    assert_is(multiply(*a, *b), rotations[0] * rotations[1])
    np.testing.assert_allclose(rotate(*a, *vector), rotations[0].apply(vector), atol=1e-13)
    np.testing.assert_allclose(matrix(a), rotations[0].as_matrix(), atol=1e-15)
    assert_is(from_matrix(rotations[0].as_matrix()), rotations[0])
    for one, among_others in zip((a, b), matrix(np.stack([a, b])), strict=True):
        np.testing.assert_array_equal(matrix(one), among_others)


@settings(max_examples=80, deadline=None)
@given(axes, axes, axes, st.floats(0.0, 7.0))
def test_rotation_vectors_equal_scipy_and_invert(x, y, z, angle):
    length = math.sqrt(x * x + y * y + z * z)
    vector = np.array([x, y, z]) / length * angle if length > 1e-3 else np.zeros(3)
    quaternion = from_rotation_vector(*vector)
    assert_is(quaternion, Rotation.from_rotvec(vector), 4e-16)
    if angle < 3.14:  # beyond half a turn it comes back the short way
        np.testing.assert_allclose(to_rotation_vector(*quaternion), vector, atol=4e-15)


@pytest.mark.parametrize("axis", range(3))
def test_quaternion_of_half_a_turn(axis):
    """The first component is zero, so that another is the largest."""
    expected = np.eye(4)[1 + axis]
    np.testing.assert_allclose(np.abs(from_matrix(matrix(expected))), expected, atol=1e-15)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_roll_pitch_and_heading_equal_scipy(roll, pitch, heading):
    """The heading is clockwise from north."""
    found = from_angles(roll, pitch, heading)
    assert_is(found, Rotation.from_euler("ZYX", [heading, pitch, roll]))
    np.testing.assert_allclose(to_angles(matrix(found)), [roll, pitch, heading], atol=1e-12)
    assert_is(from_heading(heading), Rotation.from_euler("Z", heading))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 0.1999, 2 * np.arcsin(np.sqrt(SMALL)) - 1e-9, 3.14])
def test_series_equal_the_general_functions(angle):
    vector = np.array([0.36, -0.48, 0.8]) * angle
    w, x, y, z = from_rotation_vector(*vector)
    np.testing.assert_allclose(from_short_rotation_vector(*vector), [w, x, y, z], atol=1e-15)
    found = to_rotation_vector(-w, -x, -y, -z)
    np.testing.assert_allclose(found, vector, rtol=1e-13, atol=1e-30)
    if x * x + y * y + z * z <= SMALL:
        found = to_small_rotation_vector(x, y, z)
        np.testing.assert_allclose(found, vector, rtol=1e-14, atol=1e-30)
