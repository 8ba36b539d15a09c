"""Messages to and from the navigator: inertial samples, states, positions, covariances; there and
back, and what cannot be used."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, NavSatFix
from std_msgs.msg import Float64MultiArray

from helpers.changed_messages import changed
from helpers.navigators import random_covariance
from isogal.earth.frames import LocalFrame, enu_axes, geodetic_to_ecef
from isogal.inertial.rotations import from_angles, from_heading, matrix
from isogal.passage import Passage
from isogal.scenario import load_scenario
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import NED_ENU
from isogal_ros.messages.imu import fill_imu, fill_noise, read_imu
from isogal_ros.messages.odometry import fill_odom, read_odometry, read_velocity
from isogal_ros.messages.position import (
    HEIGHT_VARIANCE,
    fill_fix,
    fill_pose,
    read_covariance,
    read_position,
)
from isogal_ros.messages.stamped_numbers import (
    fill_nav_covariance,
    peek_numbers_ns,
    read_nav_covariance,
)

FRAME = LocalFrame(math.radians(-38.0), math.radians(144.5), 100.0)
NS = 12_500_000_000
latitudes, longitudes, seeds = st.floats(-1.5, 1.5), st.floats(-3.14, 3.14), st.integers(0, 99)
vectors = st.tuples(*[st.floats(-50.0, 50.0)] * 3).map(np.array)
angles = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
some = settings(max_examples=25)


def test_axes_of_samples() -> None:
    """At rest and level the accelerometer feels +g upward, which is REP-103's +z; turning right is
    negative about it."""
    message = Imu()
    fill_imu(message, 0, np.array([0.0, 0.0, -9.8]), np.array([0.0, 0.0, 0.1]))
    assert (message.linear_acceleration.z, message.angular_velocity.z) == (9.8, -0.1)


def test_the_covariance_is_the_white_noise_of_a_sample() -> None:
    errors = load_scenario(None, ["imu.grade=tactical"]).imu.sensors
    message = Imu()
    fill_noise(message, errors, 0.01)
    of_force = np.reshape(message.linear_acceleration_covariance, (3, 3))
    of_rate = np.reshape(message.angular_velocity_covariance, (3, 3))
    np.testing.assert_allclose(np.diag(of_rate), 100.0 * np.square(errors.gyroscope.random_walk))
    assert np.all(np.diag(of_force) >= 100.0 * np.square(errors.accelerometer.random_walk))
    assert np.count_nonzero(of_force) == np.count_nonzero(of_rate) == 3


def odometry(state, cov=None) -> Odometry:
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "map"
    fill_odom(message, 7, FRAME, state, np.zeros(3), *(() if cov is None else (cov,)))
    return deserialize_message(serialize_message(message), Odometry)


@some
@given(latitudes, longitudes, vectors, angles, seeds)
def test_states_both_ways(latitude, longitude, velocity, angles, seed) -> None:
    attitude, cov = from_angles(*angles), random_covariance(np.ones(9), seed)
    state = np.array([latitude, longitude, 250.0, *velocity, *attitude])
    message = odometry(state, cov)
    # position: exact through ECEF
    point = message.pose.pose.position
    place = FRAME.to_geodetic([point.x, point.y, point.z])
    np.testing.assert_allclose(place, state[:3], rtol=1e-12, atol=1e-8)
    # velocity, its covariance and the attitude come back
    serialised = read_odometry(serialize_message(message))
    v, of_v, body = read_velocity(serialised, FRAME, latitude, longitude)
    np.testing.assert_allclose(v, velocity, atol=1e-12)
    np.testing.assert_allclose(of_v, cov[3:6, 3:6], atol=1e-11)
    np.testing.assert_allclose(body, matrix(attitude), atol=1e-12)
    # the pose's covariance is that of position and attitude, turned into the axes of the map
    to_map = FRAME.axes @ enu_axes(latitude, longitude).T @ NED_ENU
    both, index = np.kron(np.eye(2), to_map), [0, 1, 2, 6, 7, 8]
    expected = both @ cov[np.ix_(index, index)] @ both.T
    np.testing.assert_allclose(message.pose.covariance.reshape(6, 6), expected, atol=1e-11)


def test_a_state_by_hand() -> None:
    """At the origin, driving north-east: orientation is 45 degrees from east, velocity forward."""
    place, heading = np.radians([-38.0, 144.5]), from_heading(math.radians(45.0))
    message = odometry(np.array([*place, 100.0, 10.0, 10.0, 0.0, *heading]))
    point, turn = message.pose.pose.position, message.pose.pose.orientation
    linear = message.twist.twist.linear
    assert [point.x, point.y, point.z] == pytest.approx([0, 0, 0], abs=1e-8)
    assert [turn.w, turn.z] == pytest.approx([math.cos(math.pi / 8), math.sin(math.pi / 8)])
    assert [linear.x, linear.y, linear.z] == pytest.approx([math.sqrt(200), 0, 0], abs=1e-12)


@some
@given(latitudes, longitudes, st.floats(-100.0, 1e4), seeds)
def test_positions_both_ways(latitude, longitude, height, seed) -> None:
    message = NavSatFix()
    message.header.frame_id = "base_link"
    cov = random_covariance(np.ones(3), seed)
    fill_fix(message, 5, latitude, longitude, height, cov)
    back = read_position(message)
    np.testing.assert_allclose(back, [latitude, longitude, height], rtol=4e-16, atol=1e-15)
    np.testing.assert_array_equal(read_covariance(message), cov)
    assert message.position_covariance[0] == cov[1, 1]  # east first


def test_longitude_beyond_the_date_line() -> None:
    message = NavSatFix()
    fill_fix(message, 0, 0.0, math.radians(190.0), 0.0)
    assert message.longitude == pytest.approx(-170.0)
    assert message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN


@pytest.mark.parametrize("north", [0.0, 2.7], ids=["at the origin", "300 km away"])
def test_a_pose_is_of_the_map_where_the_plane_of_a_fix_far_away_is_tilted(north) -> None:
    message = PoseWithCovarianceStamped()
    place = np.radians(-38.0 + north), np.radians(144.5), 100.0
    fill_pose(message, 10**9, FRAME, place, np.array([[400.0, 60.0], [60.0, 100.0]]))
    point, covariance = message.pose.pose.position, np.reshape(message.pose.covariance, (6, 6))
    ecef = FRAME.axes.T @ [point.x, point.y, point.z] + FRAME.origin
    np.testing.assert_allclose(ecef, geodetic_to_ecef(*place), atol=1e-6)
    assert np.linalg.eigvalsh(covariance[:3, :3])[2] == pytest.approx(HEIGHT_VARIANCE, rel=1e-6)
    # the variance of the height hardly spills into the plane
    assert covariance[1, 1] == pytest.approx(400.0, rel=0.07 if north else 1e-9)
    assert (covariance[0, 0], covariance[0, 1]) == pytest.approx((100.0, 60.0), rel=1e-2)
    assert message.header.stamp.sec == 1


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_the_stamp_of_numbers(ns) -> None:
    message = Float64MultiArray()
    fill_nav_covariance(message, ns, np.eye(7))
    assert peek_numbers_ns(serialize_message(message)) == ns


def told(states: int) -> Passage | None:
    """What has become of so many errors since the last fix; 0 = nothing is said."""
    if not states:
        return None
    covariances = (random_covariance(np.ones(states), seed) for seed in (1, 2, 3))
    shapes = states, (states, states), 2, (2, states - 7), 7
    arrays = (np.random.default_rng(3).random(shape) for shape in shapes)
    (before, smoothed, after), (mean, cross, *rest) = covariances, arrays
    return Passage(7.25, before, mean, smoothed, cross, after, *rest)


@pytest.mark.parametrize(("size", "states"), [(4, 0), (7, 0), (7, 7), (7, 9)])
def test_the_covariance_there_and_back(size, states) -> None:
    message, cov, said = Float64MultiArray(), random_covariance(np.ones(size), 1), told(states)
    fill_nav_covariance(message, NS, cov, said)
    assert list(message.data[:2]) == [12.0, 500_000_000.0]
    found, passage = read_nav_covariance(message)
    np.testing.assert_array_equal(found, cov)
    assert (passage is None) == (said is None)
    if said is not None:
        assert passage.begin == said.begin
        for one, other in zip(passage.arrays, said.arrays, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("states", "change", "words"),
    [
        (7, lambda data: [*data[:-1], math.nan], "not finite"),
        (9, lambda data: data[:-1], "no passage"),
        (0, lambda data: data[:20], "7 x 7 or 4 x 4"),
    ],
)
def test_covariances_that_cannot_be_used(states, change, words) -> None:
    message = Float64MultiArray()
    fill_nav_covariance(message, NS, np.eye(7), told(states))
    with pytest.raises(BadMessageError, match=words):
        read_nav_covariance(Float64MultiArray(data=change(message.data.tolist())))


@pytest.mark.parametrize("data", [[1.0], [math.nan, 0.0, 1.0], [1.0, -5.0, 0.0], [1e300, 0.0]])
def test_numbers_without_a_stamp_are_refused(data) -> None:
    with pytest.raises(BadMessageError, match=r"numbers|stamp"):
        peek_numbers_ns(serialize_message(Float64MultiArray(data=data)))


def sample(**values):
    """An inertial sample as it comes."""
    message = Imu()
    message.header.frame_id, message.linear_acceleration.z = "base_link", 9.8
    return serialize_message(changed(message, **values))


def state(**values):
    return changed(odometry(np.array([0.1, 0.2, 0, 1, 0, 0, 1, 0, 0, 0.0]), np.eye(9)), **values)


def fix(**values):
    message = NavSatFix()
    fill_fix(message, 5, 0.1, 0.2, 0.0, np.eye(3))
    return changed(message, **{"header__frame_id": "base_link", **values})


def read_state(message):
    read_velocity(read_odometry(serialize_message(message)), FRAME, 0.1, 0.2)


def read_fix(message):
    read_position(message)
    read_covariance(message)


NEGATIVE = -np.eye(3).ravel()


@pytest.mark.parametrize(("read", "message", "words"), [
    (read_imu, sample(header__frame_id="camera"), "frame_id must be 'base_link', is 'camera'"),
    (read_imu, sample(linear_acceleration__z=math.nan), "not finite"),
    (read_imu, sample(angular_velocity_covariance=NEGATIVE), "without specific force"),
    (read_imu, sample(angular_velocity_covariance=2.0 * NEGATIVE), "negative variance"),
    (read_state, state(twist__twist__linear__y=1e300), "or above"),
    (read_state, state(twist__covariance=np.full(36, -1e300)), "covariance has numbers above"),
    (read_state, state(twist__covariance=np.full(36, np.nan)), "covariance is not finite"),
    (read_state, state(pose__pose__orientation__w=2.0), "unit quaternion"),
    (read_state, state(child_frame_id="wheel"), "child_frame_id must be 'base_link', is 'wheel'"),
    (read_state, state(header__frame_id="odom"), "frame_id must be 'map', is 'odom'"),
    (read_fix, fix(latitude=math.nan), "not finite"),
    (read_fix, fix(altitude=math.nan), "not finite"),
    (read_fix, fix(latitude=91.0), "no such place"),
    (read_fix, fix(longitude=400.0), "no such place"),
    (read_fix, fix(position_covariance=NEGATIVE), "negative variance"),
    (read_fix, fix(position_covariance_type=NavSatFix.COVARIANCE_TYPE_UNKNOWN), "not known"),
    (read_fix, fix(header__frame_id="antenna"), "frame_id must be"),
])  # fmt: skip
def test_what_cannot_be_used(read, message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        read(message)
