"""Messages of sensors beside the IMU."""

import math
import re
from functools import partial

import numpy as np
import pytest
from geometry_msgs.msg import (
    Point,
    PoseWithCovarianceStamped,
    Quaternion,
    TwistWithCovarianceStamped,
)
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import FluidPressure, Imu, NavSatFix

from helpers.changed_messages import changed
from helpers.node_bench import bench
from isogal.earth.frames import LocalFrame
from isogal.scenario import Height
from isogal.scenario.aids import HeadingAid
from isogal_ros import topics
from isogal_ros.messages.aids import (
    fill_aid,
    fill_pressure,
    fill_twist,
    read_heading,
    read_pose_position,
    read_position_fix,
    read_pressure,
    read_velocity,
)
from isogal_ros.messages.checks import BadMessageError

AIDS = "height.source=barometer", "velocity.kind=dvl", "velocity.interval=2"
BAROMETER = Height(source="barometer")
FRAME = LocalFrame(math.radians(-38.0), math.radians(179.9), 100.0)


def test_what_is_in_another_unit_is_said_and_does_no_harm(scenario) -> None:
    """hPa, knots: dropped and named; what comes in the right unit after them is used."""
    with bench(topics.UKF_FUSION, scenario(*AIDS)) as it:
        pressure, velocity = FluidPressure(), TwistWithCovarianceStamped()
        velocity.header.frame_id = "base_link"
        height = it.node.scenario.route.height
        start = it.node._navigation._beginning.start.velocity
        body = np.array([float(np.hypot(*start[:2])), 0.0, 0.0])
        for second in range(1, 9):
            ns = second * 1_000_000_000
            fill_pressure(pressure, ns, height, BAROMETER)
            fill_twist(velocity, ns, body)
            if second == 4:
                pressure.fluid_pressure /= 100.0
                velocity.twist.twist.linear.x *= 1.94384
            it.publish(topics.BAROMETER, pressure)
            if second % 2 == 0:
                it.publish(topics.VELOCITY, velocity)
            it.imu(second)
        said = str(it.says())
        assert re.search(r"barometer.*\] where \[.*\] was expected", said), said[:5000]
        assert re.search(r"velocity.*\] where \[.*\] was expected", said), said
        figures = it.node.health.figures
        assert figures["barometer/data_raw used"] == 7
        assert figures["velocity/data_raw used"] == 3


def pose(x, y, z, variances=(0.0, 0.0, 0.0)):
    place = Point(x=x, y=y, z=z)
    covariance = np.diag([*variances, 0.0, 0.0, 0.0]).ravel()
    message = PoseWithCovarianceStamped()
    return changed(
        message, header__frame_id="map", pose__pose__position=place, pose__covariance=covariance
    )


@pytest.mark.parametrize("heading", [-3.0, 1.2])
def test_a_heading_there_and_back(heading) -> None:
    message = Imu()
    aid = HeadingAid(sigma=0.03, correlated_sigma=0.04)
    fill_aid(message, 5, np.array(heading), aid, aid)
    assert read_heading(message) == pytest.approx((heading, 0.0025))


def test_a_heading_of_a_vehicle_that_is_tilted() -> None:
    """Nose up by 30 degrees, rolled by 20: the bow's heading stays."""
    turn = Rotation.from_euler("ZYX", [0.7, -math.radians(30.0), math.radians(20.0)])
    x, y, z, w = turn.as_quat().tolist()
    message = Imu(orientation=Quaternion(x=x, y=y, z=z, w=w))
    assert read_heading(message)[0] == pytest.approx(math.pi / 2 - 0.7)


def level(**values):
    """An orientation."""
    return changed(Imu(orientation=Quaternion(w=1.0)), **values)


def somewhere(**values):
    """A pose."""
    return changed(pose(1.0, 2.0, 3.0), **values)


def satellites(**values):
    """A position."""
    return changed(NavSatFix(latitude=50.0), **values)


PRESSURE = partial(read_pressure, settings=BAROMETER)
VELOCITY = partial(read_velocity, frame="")
PLACE = partial(read_pose_position, frame=FRAME)
NEGATIVE = -np.eye(6).ravel() / 2.0


@pytest.mark.parametrize(("read", "message", "words"), [
    (PRESSURE, FluidPressure(fluid_pressure=math.nan), "not finite"),
    (PRESSURE, FluidPressure(fluid_pressure=-1.0), "-1 Pa"),
    (VELOCITY, changed(TwistWithCovarianceStamped(), twist__covariance=NEGATIVE), "negative"),
    (PLACE, somewhere(header__frame_id="odom"), "frame_id must be 'map', is 'odom'"),
    (PLACE, somewhere(pose__pose__position__x=math.nan), "not finite"),
    (PLACE, somewhere(pose__pose__position__x=1e9), "not on the Earth"),
    (PLACE, somewhere(pose__covariance=NEGATIVE), "negative variance"),
    (read_heading, level(orientation_covariance=-np.ones(9)), "without orientation"),
    (read_heading, level(orientation__w=math.nan), "unit quaternion"),
    (read_heading, level(orientation_covariance=-0.5 * np.ones(9)), "negative variance"),
    (read_heading, level(orientation=Quaternion(y=-(0.5**0.5), w=0.5**0.5)), "bow points up"),
    (read_position_fix, satellites(header__frame_id="NAD27"), "WGS 84"),
    (read_position_fix, satellites(header__frame_id="EPSG:4267"), "WGS 84"),
    (read_position_fix, satellites(altitude=math.inf), "not finite"),
])  # fmt: skip
def test_what_cannot_be_used(read, message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        read(message)


def test_a_frame_that_names_no_datum_may_be_any() -> None:
    place, covariance = read_position_fix(satellites(header__frame_id="gnss_link"))
    assert place == pytest.approx([math.radians(50.0), 0.0, 0.0])
    assert covariance is None
