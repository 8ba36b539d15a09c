"""Messages of drivers turned into the graph's: types, units, frames, axes."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu
from std_msgs.msg import Float32, Float64

from isogal.errors import InputError
from isogal.inertial.rotations import from_heading
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter
from isogal_ros.messages.aids import read_heading, read_pressure, read_velocity
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.drivers import Driver, Entrance, takes_others, type_taken
from isogal_ros.messages.frames import BASE, FrameNames
from isogal_ros.messages.gravimeter import gravity
from isogal_ros.messages.imu import fill_imu, read_imu
from isogal_ros.messages.stamps import to_ns
from isogal_ros.topics import type_name

NS = 5_000_000_000


def taken(topic, message, **driver):
    drivers = {topic.name: Driver(**driver)} if driver else {}
    return Entrance(drivers).take(topic, message, NS)


@pytest.fixture
def gravimeter(scenario) -> Adapter:
    return gravity(scenario("gravimeter.quantity=gravity"))


def test_a_gravimeter_that_publishes_a_number_in_mgal(gravimeter) -> None:
    found = taken(topics.GRAVIMETRY, Float64(data=980_123.4), unit="mGal")
    assert gravimeter.read_raw(found)[0] == pytest.approx(9.801234)
    assert to_ns(found.header.stamp) == NS


def test_variance_goes_by_the_square_of_the_unit(gravimeter) -> None:
    message = gravimeter.write_raw(NS, 980_123.4, 4.0, None)
    value, variance = gravimeter.read_raw(taken(topics.GRAVIMETRY, message, unit="mGal"))
    assert (value, variance) == pytest.approx((9.801234, 4e-10))


def test_without_a_unit_a_number_is_si(gravimeter) -> None:
    message = taken(topics.GRAVIMETRY, Float32(data=980_123.4))
    with pytest.raises(BadMessageError):
        gravimeter.read_raw(message)


def test_an_imu_in_its_own_frame_and_axes() -> None:
    """Mounted upside down, facing aft: roll 180, yaw 180."""
    message = Imu()
    message.header.frame_id = "imu_link"
    force, rate = np.array([0.1, 0.2, -9.8]), np.array([0.01, -0.02, 0.03])
    fill_imu(message, NS, np.array([-0.1, 0.2, 9.8]), np.array([-0.01, -0.02, -0.03]))
    found = taken(topics.IMU, message, frame="imu_link", rotation=(180.0, 0.0, 180.0))
    for given_, wanted in zip(read_imu(serialize_message(found))[:2], (force, rate), strict=True):
        np.testing.assert_allclose(given_, wanted, atol=1e-12)


def test_a_frame_that_is_not_the_drivers_is_left_to_the_reader() -> None:
    message = Imu()
    message.header.frame_id = "other"
    with pytest.raises(BadMessageError, match="frame_id must be 'base_link', is 'other'"):
        read_imu(serialize_message(taken(topics.IMU, message, frame="imu_link")))


@given(st.tuples(*[st.floats(-180.0, 180.0)] * 3), st.tuples(*[st.floats(-9.0, 9.0)] * 3))
def test_a_rotation_keeps_lengths_and_is_that_of_a_urdf(rotation, vector) -> None:
    message = topics.VELOCITY.type()
    linear = message.twist.twist.linear
    linear.x, linear.y, linear.z = vector
    found = taken(topics.VELOCITY, message, frame="", rotation=rotation)
    velocity, _ = read_velocity(found)
    assert np.linalg.norm(velocity) == pytest.approx(np.linalg.norm(vector), abs=1e-9)
    roll, pitch, yaw = np.radians(rotation)
    # the sensor's forward axis in the frame's, of a URDF's rpy
    forward = [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)]
    np.testing.assert_allclose(Driver(rotation=rotation).turn[:, 0], forward, atol=1e-12)
    assert Driver(rotation=rotation).turn[2, 1] == pytest.approx(math.cos(pitch) * math.sin(roll))


def test_an_axis_that_is_not_measured_stays_so() -> None:
    message = topics.VELOCITY.type()
    message.twist.twist.linear.x = 5.0
    message.twist.covariance[0], message.twist.covariance[14] = 0.04, -1.0
    found, covariance = read_velocity(
        taken(topics.VELOCITY, message, frame="", rotation=(0.0, 0.0, 90.0))
    )
    np.testing.assert_allclose(found, [0.0, -5.0, np.nan], atol=1e-12)
    np.testing.assert_allclose(np.diag(covariance), [0.0, 0.04, 0.0], atol=1e-12)
    tilted, _ = read_velocity(taken(topics.VELOCITY, message, frame="", rotation=(0.0, 45.0, 0.0)))
    assert np.isnan(tilted[[0, 2]]).all()  # both have a part of it


def test_velocities_of_other_types_and_units() -> None:
    twist, odometry = TwistStamped(), Odometry(child_frame_id=BASE)
    twist.header.frame_id = BASE
    twist.twist.linear.x = odometry.twist.twist.linear.x = 10.0
    found, _ = read_velocity(taken(*topics.aid_topics("velocity", "log"), twist, unit="kn"))
    assert found[0] == pytest.approx(5.14444, rel=1e-5)
    assert read_velocity(taken(topics.VELOCITY, odometry))[0][0] == 10.0


def test_pressure_and_heading_as_numbers(scenario) -> None:
    height = scenario("height.source=barometer").height
    found = taken(topics.BAROMETER, Float64(data=1013.25), unit="hPa")
    assert read_pressure(found, height)[0] == pytest.approx(101325.0)
    (bow,) = topics.aid_topics("heading")
    assert read_heading(taken(bow, Float64(data=100.0)))[0] == pytest.approx(math.radians(100.0))


def test_the_orientation_of_a_turned_heading_sensor() -> None:
    message = Imu()
    q = from_heading(-math.radians(30.0))  # about up: the yaw, ENU
    message.orientation.w, message.orientation.z = float(q[0]), -float(q[3])
    plain = read_heading(message)[0]
    turned = taken(*topics.aid_topics("heading"), message, rotation=(0.0, 0.0, 90.0))
    assert math.remainder(read_heading(turned)[0] - plain, math.tau) == pytest.approx(math.pi / 2)


def test_types_taken() -> None:
    fix, pose = topics.aid_topics("position", "radar")
    assert type_taken(pose, [type_name(PoseStamped)]) is PoseStamped
    assert type_taken(topics.GRAVIMETRY, ["std_msgs/msg/String"]) is None
    both = [type_name(Float64), type_name(topics.GRAVIMETRY.type)]
    assert type_taken(topics.GRAVIMETRY, both) is topics.GRAVIMETRY.type
    assert not takes_others(fix)


def test_frames_of_other_names_and_back() -> None:
    names = FrameNames("world", "odom", "hull", "ship")
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "map"
    for _ in range(2):  # messages are used again
        names.outward(message)
        assert (message.header.frame_id, message.child_frame_id) == ("ship/world", "ship/hull")
    data = serialize_message(message)
    found = Entrance({}, names).take_serialised(topics.NAV_ODOM, data, type_name(Odometry), NS)
    inside = deserialize_message(found, Odometry)
    assert (inside.header.frame_id, inside.child_frame_id) == ("map", "base_link")


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"gravimeter/data": {}}, "'gravimeter/data'; did you mean 'gravimeter/data_raw'"),
        ({"gravimeter/data_raw": {"unit": "gal"}}, "unit: must be one of m/s2, mGal"),
        ({"imu/data_raw": {"unit": "g"}}, "unit: must be empty"),
        ({"imu/data_raw": {"frames": "x"}}, "unknown key 'frames'"),
        ({"imu/data_raw": {"rotation": [1, 2]}}, "rotation"),
    ],
)
def test_bad_entries(entry, words) -> None:
    with pytest.raises(InputError, match=words):
        Entrance.of(Entrance().text(), entry)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"drivers": {}, "names": {"x": 1}}'])
def test_a_damaged_text(text) -> None:
    with pytest.raises(InputError, match="is damaged"):
        Entrance.of(text, {})


def test_a_recording_keeps_what_it_was_told() -> None:
    one = Entrance({"imu/data_raw": Driver(frame="imu_link")}, FrameNames(map="world"))
    assert Entrance.of(one.text(), {}) == one
