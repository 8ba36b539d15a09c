"""Barometer and velocity aid as publishers of their own in the graph, and in a replay."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TwistWithCovarianceStamped
from sensor_msgs.msg import FluidPressure

from helpers.node_bench import bench, run_here
from helpers.recordings import record, same
from isogal.montecarlo.engine import simulate
from isogal.scenario import Height
from isogal.sensors.barometer import pressure_of
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.replay import replay
from isogal_ros.messages.aids import fill_pressure, fill_velocity, read_pressure, read_velocity
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.nodes.signals import Interrupt

AIDS = (
    "height.source=barometer",
    "velocity.kind=dvl",
    "velocity.current_sigma=0.1",
    "velocity.interval=2",
)


def test_the_graph_is_the_closed_loop_of_the_library_and_its_replay(scenario, tmp_path) -> None:
    short = scenario("route.duration=130.0", *AIDS)
    run_here(short, tmp_path / "bag")
    same(record(tmp_path / "bag", short), simulate(short, [0]), 1e-4)
    counts = dict.fromkeys((topics.BAROMETER.name, topics.VELOCITY.name), 0)
    for item in BagReader(tmp_path / "bag").messages():
        if item.topic.lstrip("/") in counts:
            counts[item.topic.lstrip("/")] += 1
    assert list(counts.values()) == [130, 65]
    again = replay(BagReader(tmp_path / "bag"), Interrupt(), lambda progress: None)
    assert again.comparison.largest_difference < 1e-6
    assert again.comparison.common == again.comparison.recorded > 0


def test_what_is_wrong_with_a_unit_is_said_and_does_no_harm(scenario) -> None:
    """hPa, knots: dropped and named; what comes in the right unit after them is used."""
    with bench(topics.UKF_FUSION, scenario(*AIDS)) as it:
        pressure, velocity = FluidPressure(), TwistWithCovarianceStamped()
        velocity.header.frame_id = "base_link"
        height = it.node.scenario.route.height
        body = np.array([float(np.hypot(*_start(it)[:2])), 0.0, 0.0])
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


def _start(it):
    return it.node._navigation._start.velocity


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
