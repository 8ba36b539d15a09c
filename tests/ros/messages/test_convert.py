"""Messages to arrays and back."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import AccelWithCovarianceStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, NavSatFix, NavSatStatus
from std_msgs.msg import Float64MultiArray

from isogal.earth.frames import LocalFrame, enu_axes
from isogal.inertial.rotations import from_heading, matrix
from isogal.matching.interfaces import Candidates, Information
from isogal.scenario import load_scenario
from isogal_ros.messages import convert
from isogal_ros.messages.odometry import quaternion
from isogal_ros.messages.stamps import (
    from_ns,
    from_seconds,
    peek_ns,
    peek_numbers_ns,
    set_stamp,
    to_ns,
    to_seconds,
)
from isogal_ros.nodes.health import BadMessageError

finite = st.floats(-50.0, 50.0)
vectors = st.tuples(finite, finite, finite).map(np.array)
latitudes = st.floats(-1.5, 1.5)
longitudes = st.floats(-3.14, 3.14)
stamps = st.integers(0, 2**31 * 10**9 - 1)


def turned(a: float, b: float, c: float) -> np.ndarray:
    """A quaternion FRD to NED of heading a, then b about y, then c about x."""
    q = np.array([math.cos(a / 2), 0, 0, math.sin(a / 2)])
    for angle, axis in ((b, 2), (c, 1)):
        p = np.zeros(4)
        p[0], p[axis] = math.cos(angle / 2), math.sin(angle / 2)
        w, x, y, z = q
        q = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]) @ p
    return q


attitudes = st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)).map(
    lambda t: turned(*t)
)


def covariance(size: int, seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).standard_normal((size, size))
    return root @ root.T + np.eye(size)


@given(stamps)
def test_stamps(ns) -> None:
    assert to_ns(from_ns(ns)) == ns
    message = Imu()
    set_stamp(message.header.stamp, ns)
    message.header.frame_id = "base_link"
    assert peek_ns(serialize_message(message)) == ns
    numbers = Float64MultiArray()
    convert.fill_numbers(numbers, ns, np.eye(7))
    assert peek_numbers_ns(serialize_message(numbers)) == ns


@given(st.floats(0.0, 1e6))
def test_seconds(seconds) -> None:
    assert abs(to_seconds(from_seconds(seconds)) - seconds) <= 1e-9


def test_numbers_without_a_stamp_are_refused() -> None:
    for data in ([], [1.0], [float("nan"), 0.0, 1.0], [1.0, -5.0, 0.0], [1e300, 0.0]):
        with pytest.raises(ValueError, match=r"numbers|stamp"):
            peek_numbers_ns(serialize_message(Float64MultiArray(data=data)))


@given(stamps, vectors, vectors)
def test_imu(ns, force, rate) -> None:
    message = Imu()
    message.header.frame_id = "base_link"
    convert.fill_imu(message, ns, force, rate)
    got = convert.read_imu(deserialize_message(serialize_message(message), Imu))
    np.testing.assert_array_equal(got, [force, rate])


def test_imu_axes() -> None:
    """At rest and level the accelerometer feels +g upward, which is REP-103's +z; turning right is
    negative about it."""
    message = Imu()
    convert.fill_imu(message, 0, np.array([0.0, 0.0, -9.8]), np.array([0.0, 0.0, 0.1]))
    assert message.linear_acceleration.z == 9.8
    assert message.angular_velocity.z == -0.1


@given(latitudes, longitudes, st.floats(-100.0, 1e4), st.integers(0, 99))
def test_fix(latitude, longitude, height, seed) -> None:
    message = NavSatFix()
    message.header.frame_id = "base_link"
    cov = covariance(3, seed)
    convert.fill_fix(message, 5, latitude, longitude, height, cov)
    back = convert.read_position(message)
    np.testing.assert_allclose(back, [latitude, longitude, height], rtol=4e-16, atol=1e-15)
    np.testing.assert_array_equal(convert.read_covariance(message), cov)
    assert message.position_covariance[0] == cov[1, 1]  # east first
    assert message.position_covariance[4] == cov[0, 0]


def test_longitude_beyond_the_date_line() -> None:
    message = NavSatFix()
    convert.fill_fix(message, 0, 0.0, math.radians(190.0), 0.0)
    assert message.longitude == pytest.approx(-170.0)
    assert message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN


def odometry(frame, state, cov=None) -> Odometry:
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "map"
    convert.fill_odom(message, 7, frame, state, np.zeros(3), *(() if cov is None else (cov,)))
    return deserialize_message(serialize_message(message), Odometry)


@given(latitudes, longitudes, vectors, attitudes, st.integers(0, 99))
def test_odometry(latitude, longitude, velocity, attitude, seed) -> None:
    frame = LocalFrame(-0.63, 2.53, 100.0)
    cov = covariance(9, seed)
    state = np.array([latitude, longitude, 250.0, *velocity, *attitude])
    message = odometry(frame, state, cov)
    # position: exact through ECEF
    point = message.pose.pose.position
    np.testing.assert_allclose(
        frame.to_geodetic([point.x, point.y, point.z]), state[:3], rtol=1e-12, atol=1e-8
    )
    # velocity, its covariance and the attitude come back
    v, of_v, body = convert.read_velocity(message, frame, latitude, longitude)
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


def test_odometry_by_hand() -> None:
    """At the origin, driving north-east: orientation is 45 degrees from east, velocity forward."""
    frame = LocalFrame(math.radians(-38.0), math.radians(144.5), 100.0)
    state = np.array(
        [
            math.radians(-38.0),
            math.radians(144.5),
            100.0,
            10.0,
            10.0,
            0.0,
            *from_heading(math.radians(45.0)),
        ]
    )
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


@given(attitudes)
def test_quaternion_of_a_matrix(attitude) -> None:
    q = quaternion(matrix(attitude))
    assert min(np.abs(q - attitude).max(), np.abs(q + attitude).max()) < 1e-12


def test_accel() -> None:
    message = AccelWithCovarianceStamped()
    message.header.frame_id = "gravimeter_link"
    convert.fill_accel(message, 3, 9.80665, 1e-10)
    assert convert.read_accel(message) == (9.80665, 1e-10)
    assert message.accel.covariance[0] == convert.NOT_MEASURED


@pytest.mark.parametrize("size", [4, 7])
def test_nav_covariance(size) -> None:
    message = Float64MultiArray()
    cov = covariance(size, 1)
    convert.fill_numbers(message, 12_500_000_000, cov)
    assert list(message.data[:2]) == [12.0, 500_000_000.0]
    np.testing.assert_array_equal(convert.read_nav_covariance(message), cov)


@pytest.mark.parametrize(
    "information",
    [
        None,
        Information(np.arange(4.0), covariance(4, 2)),
        Information(np.arange(7.0), covariance(7, 2)),
    ],
)
@pytest.mark.parametrize("reset", [False, True])
def test_information(information, reset) -> None:
    message = Float64MultiArray()
    convert.fill_information(message, 1, reset, information)
    got_reset, got = convert.read_information(message)
    assert got_reset is reset
    assert (got is None) == (information is None)
    if information is not None:
        np.testing.assert_array_equal(got.vector, information.vector)
        np.testing.assert_array_equal(got.matrix, information.matrix)


def test_candidates() -> None:
    random = np.random.default_rng(0)
    candidates = Candidates(
        random.uniform(-1, 1, 9),
        random.uniform(-3, 3, 9),
        random.uniform(0, 1, 9),
        np.arange(9) % 4,
    )
    cloud = convert.candidates_cloud(8, candidates)
    assert [field.name for field in cloud.fields] == ["latitude", "longitude", "weight", "scan"]
    assert cloud.width * cloud.point_step == cloud.row_step == len(cloud.data)
    back = convert.read_candidates(cloud)
    np.testing.assert_allclose(back.latitude, candidates.latitude, atol=1e-15)
    np.testing.assert_allclose(back.longitude, candidates.longitude, atol=1e-15)
    np.testing.assert_array_equal(back.weight, candidates.weight)
    np.testing.assert_array_equal(back.scan, candidates.scan)
    assert convert.candidates_cloud(8, None).width == 0


def test_frame_map_is_at_the_first_route_point() -> None:
    straight = convert.map_frame(load_scenario(None, ["route.height=250.0"]))
    along = convert.map_frame(
        load_scenario(
            None, ["route.height=250.0", "route.waypoints=[[-38, 144.5, 20], [-37, 146, 20]]"]
        )
    )
    np.testing.assert_array_equal(straight.origin, along.origin)
    np.testing.assert_allclose(
        straight.from_geodetic(math.radians(-38), math.radians(144.5), 250.0), 0, atol=1e-8
    )


def bad_imu(**changes) -> Imu:
    message = Imu()
    message.header.frame_id = changes.pop("frame", "base_link")
    message.linear_acceleration.z = changes.pop("z", 9.8)
    message.angular_velocity_covariance = np.diag([changes.pop("variance", 1.0)] * 3).ravel()
    assert not changes
    return message


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (bad_imu(frame="camera"), "frame_id must be 'base_link', is 'camera'"),
        (bad_imu(z=math.nan), "not finite"),
        (bad_imu(z=math.inf), "not finite"),
        (bad_imu(z=5e3), "above 1000"),
        (bad_imu(variance=-1.0), "without specific force"),
        (bad_imu(variance=-2.0), "negative variance"),
    ],
)
def test_bad_imu(message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        convert.read_imu(message)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"latitude": math.nan}, "not finite"),
        ({"latitude": 91.0}, "no such place"),
        ({"longitude": 400.0}, "no such place"),
        ({"position_covariance": np.diag([1.0, -1.0, 1.0]).ravel()}, "negative variance"),
        ({"position_covariance": np.full(9, math.nan)}, "not finite"),
        ({"position_covariance_type": NavSatFix.COVARIANCE_TYPE_UNKNOWN}, "not known"),
        ({"header.frame_id": "antenna"}, "frame_id must be"),
    ],
)
def test_bad_fix(change, words) -> None:
    message = NavSatFix(status=NavSatStatus(status=NavSatStatus.STATUS_FIX))
    message.header.frame_id = "base_link"
    message.position_covariance = np.eye(3).ravel()
    message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_KNOWN
    for name, value in change.items():
        target, _, last = name.rpartition(".")
        setattr(getattr(message, target) if target else message, last, value)
    with pytest.raises(BadMessageError, match=words):
        convert.read_position(message)
        convert.read_covariance(message)


def test_bad_odometry() -> None:
    frame = LocalFrame(0.1, 0.2)
    good = odometry(frame, np.array([0.1, 0.2, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), np.eye(9))
    convert.read_velocity(good, frame, 0.1, 0.2)
    good.pose.pose.orientation.w = 2.0
    with pytest.raises(BadMessageError, match="unit quaternion"):
        convert.read_velocity(good, frame, 0.1, 0.2)
    good.child_frame_id = "wheel"
    with pytest.raises(BadMessageError, match="child_frame_id must be 'base_link'"):
        convert.read_velocity(good, frame, 0.1, 0.2)


def test_bad_readings_and_numbers() -> None:
    message = AccelWithCovarianceStamped()
    message.header.frame_id = "gravimeter_link"
    convert.fill_accel(message, 0, 9.8, -1.0)
    with pytest.raises(BadMessageError, match="negative variance"):
        convert.read_accel(message)
    convert.fill_accel(message, 0, math.nan, 1.0)
    with pytest.raises(BadMessageError, match="not finite"):
        convert.read_accel(message)
    with pytest.raises(BadMessageError, match="7 x 7 or 4 x 4"):
        convert.read_nav_covariance(Float64MultiArray(data=[0.0] * 20))
    with pytest.raises(BadMessageError, match="vector of 4"):
        convert.read_information(Float64MultiArray(data=[0.0] * 20))
    with pytest.raises(BadMessageError, match="fields must be"):
        convert.read_candidates(convert.candidates_cloud(0, None).__class__())
