"""Inertial samples as messages, and what cannot be used."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from isogal.scenario import load_scenario
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.imu import fill_imu, fill_noise, read_imu

finite = st.floats(-50.0, 50.0)
vectors = st.tuples(finite, finite, finite).map(np.array)


@given(vectors, vectors, st.text("abc/_", max_size=20))
def test_both_ways(force, rate, frame) -> None:
    message = Imu()
    message.header.frame_id = frame
    fill_imu(message, 5, force, rate)
    message.angular_velocity_covariance = np.diag([0.0, 2.0, 0.0]).ravel()
    got = read_imu(serialize_message(message), frame)
    assert got[2].tolist() == [0.0, 2.0, 0.0]
    np.testing.assert_array_equal(got[:2], [force, rate])


def test_axes() -> None:
    """At rest and level the accelerometer feels +g upward, which is REP-103's +z; turning right is
    negative about it."""
    message = Imu()
    fill_imu(message, 0, np.array([0.0, 0.0, -9.8]), np.array([0.0, 0.0, 0.1]))
    assert message.linear_acceleration.z == 9.8
    assert message.angular_velocity.z == -0.1


@pytest.mark.parametrize(("words", "frame", "up", "variance"), [
    ("frame_id must be 'base_link', is 'camera'", "camera", 9.8, 1.0),
    ("not finite", "base_link", math.nan, 1.0),
    ("not finite", "base_link", math.inf, 1.0),
    ("above 1000", "base_link", 5e3, 1.0),
    ("without specific force", "base_link", 9.8, -1.0),
    ("negative variance", "base_link", 9.8, -2.0),
])  # fmt: skip
def test_samples_that_cannot_be_used(words, frame, up, variance) -> None:
    message = Imu(angular_velocity_covariance=variance * np.eye(3).ravel())
    message.header.frame_id, message.linear_acceleration.z = frame, up
    with pytest.raises(BadMessageError, match=words):
        read_imu(serialize_message(message))


def test_the_covariance_is_the_white_noise_of_a_sample() -> None:
    errors = load_scenario(None, ["imu.grade=tactical"]).imu.sensors
    message = Imu()
    fill_noise(message, errors, 0.01)
    of_force = np.reshape(message.linear_acceleration_covariance, (3, 3))
    of_rate = np.reshape(message.angular_velocity_covariance, (3, 3))
    np.testing.assert_allclose(np.diag(of_rate), 100.0 * np.square(errors.gyroscope.random_walk))
    assert np.all(np.diag(of_force) >= 100.0 * np.square(errors.accelerometer.random_walk))
    assert np.count_nonzero(of_force) == np.count_nonzero(of_rate) == 3
