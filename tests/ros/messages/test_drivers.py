"""Messages of drivers turned into the graph's: types, units, frames, axes; at a node, and in a
recording."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure, Imu
from std_msgs.msg import Float32, Float64

from helpers.node_bench import bench
from isogal.errors import InputError
from isogal.scenario import Height, Scenario
from isogal_ros import topics
from isogal_ros.messages.aids import read_heading, read_pressure, read_velocity
from isogal_ros.messages.drivers import Driver, Entrance
from isogal_ros.messages.frames import BASE
from isogal_ros.messages.gravimeter import gravity
from isogal_ros.messages.imu import fill_imu, read_imu
from isogal_ros.messages.stamps import to_ns
from isogal_ros.nodes.health import WARN

NS = 5_000_000_000


def taken(topic, message, **driver):
    drivers = {topic.name: Driver(**driver)} if driver else {}
    return Entrance(drivers).take(topic, message, NS)


def test_a_gravimeter_in_mgal_of_its_own_type_or_a_number() -> None:
    """The variance goes by the square of the unit."""
    gravimeter = gravity(Scenario())
    found = taken(topics.GRAVIMETRY, Float64(data=980_123.4), unit="mGal")
    assert gravimeter.read_raw(found)[0] == pytest.approx(9.801234)
    assert to_ns(found.header.stamp) == NS
    message = gravimeter.write_raw(NS, 980_123.4, 4.0, None)
    value, variance = gravimeter.read_raw(taken(topics.GRAVIMETRY, message, unit="mGal"))
    assert (value, variance) == pytest.approx((9.801234, 4e-10))


def test_an_imu_in_its_own_frame_and_axes() -> None:
    """Mounted upside down, facing aft: roll 180, yaw 180."""
    message = Imu()
    message.header.frame_id = "imu_link"
    force, rate = np.array([0.1, 0.2, -9.8]), np.array([0.01, -0.02, 0.03])
    fill_imu(message, NS, np.array([-0.1, 0.2, 9.8]), np.array([-0.01, -0.02, -0.03]))
    found = taken(topics.IMU, message, frame="imu_link", rotation=(180.0, 0.0, 180.0))
    for given_, wanted in zip(read_imu(serialize_message(found))[:2], (force, rate), strict=True):
        np.testing.assert_allclose(given_, wanted, atol=1e-12)


@settings(max_examples=25)
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


def test_other_types_and_units() -> None:
    twist, odometry = TwistStamped(), Odometry(child_frame_id=BASE)
    twist.header.frame_id = BASE
    twist.twist.linear.x = odometry.twist.twist.linear.x = 10.0
    found, _ = read_velocity(taken(*topics.aid_topics("velocity", "log"), twist, unit="kn"))
    assert found[0] == pytest.approx(5.14444, rel=1e-5)
    assert read_velocity(taken(topics.VELOCITY, odometry))[0][0] == 10.0
    pressure = taken(topics.BAROMETER, Float64(data=1013.25), unit="hPa")
    assert read_pressure(pressure, Height(source="barometer"))[0] == pytest.approx(0.0, abs=0.01)
    given_ = FluidPressure(fluid_pressure=1013.25, variance=4.0)
    assert taken(topics.BAROMETER, given_, unit="hPa").variance == pytest.approx(4e4)
    (bow,) = topics.aid_topics("heading")
    assert read_heading(taken(bow, Float32(data=100.0)))[0] == pytest.approx(math.radians(100.0))


@pytest.mark.parametrize(
    ("text", "entry", "words"),
    [
        (None, {"gravimeter/data": {}}, "'gravimeter/data'; did you mean 'gravimeter/data_raw'"),
        (None, {"gravimeter/data_raw": {"unit": "gal"}}, "unit: must be one of m/s2, mGal"),
        (None, {"imu/data_raw": {"unit": "g"}}, "unit: must be empty"),
        (None, {"imu/data_raw": {"rotation": [math.nan, 0, 0]}}, "must be a finite number"),
        (None, {"gnss/fix": {"translation": [math.inf, 0, 0]}}, "must be a finite number"),
        (None, {"imu/data_raw": {"frames": "x"}}, r"drivers\.imu/data_raw\.frames"),
        (
            None,
            {"imu/data_raw": {"rotation": [1, 2]}},
            r"drivers\.imu/data_raw\.rotation\.2: must",
        ),
        (None, {"gnss/fix": {"from_tf": True}}, r"drivers\.gnss/fix\.from_tf: needs `frame`"),
        ('{"drivers": {}, "names": {"x": 1}}', {}, "is damaged"),
    ],
)
def test_bad_entries(text, entry, words) -> None:
    with pytest.raises(InputError, match=words):
        Entrance.of(text or Entrance().text(), entry)


OUTSIDE = {"map_frame": "world", "base_frame": "hull", "tf_prefix": "ship"}


def test_a_mounting_that_is_not_said_is_not_guessed(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario(), drivers="{imu/data_raw: {frame: imu}}") as made:
        made.imu(1.0, frame="camera")
        level, text, _ = made.told("frame_id must be 'base_link', is 'camera'")
    assert level == WARN
    assert "imu_frame" in text


def test_frames_have_other_names_outside(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario(), **OUTSIDE) as made:
        made.imu(1.0, frame="ship/hull")
        made.imu(2.0, frame="hull")  # a driver that knows no prefix
        odometry, path = made.heard["nav/odom"][-1], made.heard["nav/path"][-1]
        assert odometry.header.stamp.sec == 2
        assert made.heard["nav/fix"][-1].header.frame_id == "ship/hull"
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("ship/world", "ship/hull")
    assert {one.header.frame_id for one in (path, *path.poses)} == {"ship/world"}
