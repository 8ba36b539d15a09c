"""Messages of barometer and velocity aid."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TwistWithCovarianceStamped
from sensor_msgs.msg import FluidPressure

from helpers.node_bench import bench
from isogal.scenario import Height
from isogal.sensors.barometer import pressure_of
from isogal_ros import topics
from isogal_ros.messages.aids import fill_pressure, fill_velocity, read_pressure, read_velocity
from isogal_ros.messages.checks import BadMessageError

AIDS = "height.source=barometer", "velocity.kind=dvl", "velocity.interval=2"


def test_what_is_wrong_with_a_unit_is_said_and_does_no_harm(scenario) -> None:
    """hPa, knots: dropped and named; what comes in the right unit after them is used."""
    with bench(topics.UKF_FUSION, scenario(*AIDS)) as it:
        pressure, velocity = FluidPressure(), TwistWithCovarianceStamped()
        velocity.header.frame_id = "base_link"
        height = it.node.scenario.route.height
        start = it.node._navigation._start.velocity
        body = np.array([float(np.hypot(*start[:2])), 0.0, 0.0])
        for second in range(1, 9):
            ns = second * 1_000_000_000
            fill_pressure(pressure, ns, height, Height(source="barometer"))
            fill_velocity(velocity, ns, body)
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
    fill_velocity(velocity, 5, np.array([20.0, -1.0, np.nan]))
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
