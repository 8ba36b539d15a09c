"""Navigation states as messages, and what cannot be used."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message

from helpers.navigators import random_covariance
from isogal.earth.frames import LocalFrame, enu_axes
from isogal.inertial.rotations import from_angles, from_heading, matrix
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.odometry import fill_odom, read_velocity

finite = st.floats(-50.0, 50.0)
vectors = st.tuples(finite, finite, finite).map(np.array)


attitudes = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)).map(
    lambda angles: from_angles(*angles)
)


def odometry(frame, state, cov=None) -> Odometry:
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "map"
    fill_odom(message, 7, frame, state, np.zeros(3), *(() if cov is None else (cov,)))
    return deserialize_message(serialize_message(message), Odometry)


@given(st.floats(-1.5, 1.5), st.floats(-3.14, 3.14), vectors, attitudes, st.integers(0, 99))
def test_both_ways(latitude, longitude, velocity, attitude, seed) -> None:
    frame = LocalFrame(-0.63, 2.53, 100.0)
    cov = random_covariance(np.ones(9), seed)
    state = np.array([latitude, longitude, 250.0, *velocity, *attitude])
    message = odometry(frame, state, cov)
    # position: exact through ECEF
    point = message.pose.pose.position
    np.testing.assert_allclose(
        frame.to_geodetic([point.x, point.y, point.z]), state[:3], rtol=1e-12, atol=1e-8
    )
    # velocity, its covariance and the attitude come back
    v, of_v, body = read_velocity(message, frame, latitude, longitude)
    np.testing.assert_allclose(v, velocity, atol=1e-12)
    np.testing.assert_allclose(of_v, cov[3:6, 3:6], atol=1e-11)
    np.testing.assert_allclose(body, matrix(attitude), atol=1e-12)
    # the pose's covariance is that of position and attitude, turned into the axes of the map
    to_map = (
        frame.axes @ enu_axes(latitude, longitude).T @ np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    )
    both = np.kron(np.eye(2), to_map)
    index = [0, 1, 2, 6, 7, 8]
    expected = both @ cov[np.ix_(index, index)] @ both.T
    np.testing.assert_allclose(message.pose.covariance.reshape(6, 6), expected, atol=1e-11)


def test_by_hand() -> None:
    """At the origin, driving north-east: orientation is 45 degrees from east, velocity forward."""
    frame = LocalFrame(math.radians(-38.0), math.radians(144.5), 100.0)
    heading = from_heading(math.radians(45.0))
    place = math.radians(-38.0), math.radians(144.5), 100.0
    state = np.array([*place, 10.0, 10.0, 0.0, *heading])
    message = odometry(frame, state)
    pose, twist = message.pose.pose, message.twist.twist
    assert [pose.position.x, pose.position.y, pose.position.z] == pytest.approx(
        [0, 0, 0], abs=1e-8
    )
    assert [pose.orientation.w, pose.orientation.z] == pytest.approx(
        [math.cos(math.pi / 8), math.sin(math.pi / 8)]
    )
    assert [twist.linear.x, twist.linear.y, twist.linear.z] == pytest.approx(
        [math.sqrt(200), 0, 0], abs=1e-12
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda bad: setattr(bad.twist.twist.linear, "y", 1e300), "or above"),
        (lambda bad: bad.twist.covariance.__setitem__(1, -1e300), "covariance has numbers above"),
        (lambda bad: bad.twist.covariance.__setitem__(1, np.nan), "covariance is not finite"),
        (lambda bad: setattr(bad.pose.pose.orientation, "w", 2.0), "unit quaternion"),
        (lambda bad: setattr(bad, "child_frame_id", "wheel"), "frame_id must be 'base_link'"),
    ],
)
def test_messages_that_cannot_be_used(change, words) -> None:
    frame, place = LocalFrame(0.1, 0.2), (0.1, 0.2)
    message = odometry(frame, np.array([*place, 0.0, 1.0, 0, 0, 1.0, 0, 0, 0]), np.eye(9))
    read_velocity(message, frame, *place)
    change(message)
    with pytest.raises(BadMessageError, match=words):
        read_velocity(message, frame, *place)
