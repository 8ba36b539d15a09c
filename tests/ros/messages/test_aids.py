"""Messages of sensors beside the IMU."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import FluidPressure, Imu, NavSatFix

from helpers.node_bench import bench
from isogal.earth.frames import LocalFrame
from isogal.scenario import Height
from isogal.scenario.aids import HeadingAid
from isogal.sensors.barometer import pressure_of
from isogal_ros import topics
from isogal_ros.messages.aids import (
    fill_heading,
    fill_pressure,
    fill_twist,
    read_heading,
    read_pose_position,
    read_position_fix,
    read_pressure,
    read_velocity,
)
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import MAP

AIDS = "height.source=barometer", "velocity.kind=dvl", "velocity.interval=2"


def test_what_is_wrong_with_a_unit_is_said_and_does_no_harm(scenario) -> None:
    """hPa, knots: dropped and named; what comes in the right unit after them is used."""
    with bench(topics.UKF_FUSION, scenario(*AIDS)) as it:
        pressure, velocity = FluidPressure(), TwistWithCovarianceStamped()
        velocity.header.frame_id = "base_link"
        height = it.node.scenario.route.height
        start = it.node._navigation.start_state().velocity
        body = np.array([float(np.hypot(*start[:2])), 0.0, 0.0])
        for second in range(1, 9):
            ns = second * 1_000_000_000
            fill_pressure(pressure, ns, height, Height(source="barometer"))
            fill_twist(velocity, ns, body)
            if second == 4:
                pressure.fluid_pressure /= 100.0
                velocity.twist.twist.linear.x *= 1.94384
            it.publish(topics.BAROMETER, pressure)
            if second % 2 == 0:
                it.publish(topics.VELOCITY, velocity)
            it.imu(second)
        said = str(it.says())
        assert "is it hPa instead of Pa?" in said
        assert "is it knots instead of m/s?" in said
        figures = it.node.health.figures
        assert figures["barometer/data_raw used"] == 7
        assert figures["velocity/data_raw used"] == 3


def test_messages_there_and_back() -> None:
    settings = Height(source="barometer")
    pressure, velocity = FluidPressure(), TwistWithCovarianceStamped()
    fill_pressure(pressure, 5, 1234.5, settings)
    assert read_pressure(pressure, settings)[1:] == pytest.approx((1234.5, 0.0))
    pressure.variance = 100.0
    slope = (pressure_of(1235.0, settings) - pressure_of(1234.0, settings)) ** -1
    assert read_pressure(pressure, settings)[2] == pytest.approx(100.0 * slope**2, rel=1e-3)
    velocity.header.frame_id = "base_link"
    fill_twist(velocity, 5, np.array([20.0, 1.0, np.nan]))
    back, covariance = read_velocity(velocity)
    np.testing.assert_array_equal(back, [20.0, -1.0, np.nan])
    assert not covariance.any()
    assert velocity.twist.twist.linear.y == 1.0
    velocity.twist.covariance[1] = 0.5
    assert read_velocity(velocity)[1][0, 1] == -0.5
    for value in (math.nan, -1.0):
        pressure.fluid_pressure = value
        with pytest.raises(BadMessageError):
            read_pressure(pressure, settings)
    velocity.twist.covariance[0] = -2.0
    with pytest.raises(BadMessageError, match="negative variance"):
        read_velocity(velocity)


FRAME = LocalFrame(math.radians(-38.0), math.radians(179.9), 100.0)


def pose(x, y, z, variances=(0.0, 0.0, 0.0)):
    message = PoseWithCovarianceStamped()
    message.header.frame_id = MAP
    point = message.pose.pose.position
    point.x, point.y, point.z = x, y, z
    for axis, variance in enumerate(variances):
        message.pose.covariance[7 * axis] = variance
    return message


def test_a_pose_beyond_the_date_line_is_a_place() -> None:
    place, covariance = read_pose_position(pose(20e3, 1e3, 5.0, (4.0, 9.0, 16.0)), FRAME)
    np.testing.assert_allclose(FRAME.from_geodetic(*place), [20e3, 1e3, 5.0], atol=1e-6)
    # east and north there are turned by 2 mrad against those of the origin
    np.testing.assert_allclose(np.diag(covariance), [9.0, 4.0, 16.0], atol=1e-3)
    assert read_pose_position(pose(0.0, 0.0, 0.0), FRAME)[1] is None


@pytest.mark.parametrize("change", ["frame", "nan", "far", "negative"])
def test_a_pose_that_is_none_is_refused(change) -> None:
    message = pose(1.0, 2.0, 3.0, (-1.0 if change == "negative" else 1.0, 1.0, 1.0))
    if change == "frame":
        message.header.frame_id = "odom"
    message.pose.pose.position.x = {"nan": math.nan, "far": 1e9}.get(change, 1.0)
    with pytest.raises(BadMessageError):
        read_pose_position(message, FRAME)


@pytest.mark.parametrize("heading", [-3.0, -0.4, 0.0, 1.2, 3.1])
def test_a_heading_there_and_back(heading) -> None:
    message = Imu()
    fill_heading(message, 5, heading, HeadingAid(sigma=0.03, correlated_sigma=0.04))
    assert read_heading(message) == pytest.approx((heading, 0.0025))


def test_a_heading_of_a_vehicle_that_is_tilted() -> None:
    """Nose up by 30 degrees, rolled by 20: the bow's heading stays."""
    message = Imu()
    yaw, pitch, roll = 0.7, -math.radians(30.0), math.radians(20.0)
    o = message.orientation
    o.x, o.y, o.z, o.w = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat().tolist()
    assert read_heading(message)[0] == pytest.approx(math.pi / 2 - yaw)


def test_an_orientation_that_is_none_is_refused() -> None:
    message = Imu()
    message.orientation_covariance[0] = -1.0
    with pytest.raises(BadMessageError, match="without orientation"):
        read_heading(message)
    other = Imu()
    other.orientation.w = math.nan
    with pytest.raises(BadMessageError, match="unit quaternion"):
        read_heading(other)


@pytest.mark.parametrize(
    ("frame", "refused"),
    [("NAD27", True), ("osgb36", True), ("EPSG:4267", True), ("gnss_link", False), ("", False)],
)
def test_another_datum_is_refused(frame, refused) -> None:
    message = NavSatFix(latitude=50.0, longitude=1.0)
    message.header.frame_id = frame
    if refused:
        with pytest.raises(BadMessageError, match="WGS 84"):
            read_position_fix(message)
    else:
        assert read_position_fix(message) is not None
