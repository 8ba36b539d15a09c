"""The sensor's node: readings of all instruments are reduced, and no message ends it."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import Range
from std_srvs.srv import Trigger

from helpers.node_bench import Bench, bench, field_of, stamps, vector_reading
from isogal.earth.gravity import normal_gradient
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction
from isogal.sensors.magnetometer import intensity
from isogal.sensors.reduction import State
from isogal_ros import topics
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.stamps import from_seconds, set_stamp
from isogal_ros.nodes.health import OK, WARN

PLACE, HERE = np.radians([55.9, -3.9]), (-0.637, 2.5656)
SENSED = 9.7952
"""m/s², of a vehicle over that place that goes 12 m/s north and 15 m/s east."""


def gravity_of(scenario, sensed, speed=(12.0, 15.0)) -> tuple[list[float], Bench]:
    """The gravity of readings 10 s apart, NaN where there is none, and the bench that made it."""
    with bench(topics.GRAVIMETER, scenario, simulate=False) as made:
        for k, value in enumerate(sensed, 1):
            made.reading(10.0 * k, value, topic=topics.GRAVIMETRY)
            made.nav(10.0 * k, *HERE, speed)
        found = [one.accel.accel.linear.z for one in made.heard["gravimeter/gravity"]]
        assert len(found) == len(sensed)
    return found, made


def range_of(seconds, value, **keys):
    message = Range(range=float(value), min_range=1.0, max_range=3000.0, **keys)
    set_stamp(message.header.stamp, from_seconds(seconds))
    return message


def test_a_gravimeters_readings_are_reduced(scenario) -> None:
    _, made = gravity_of(scenario(), [SENSED])
    for name, reduction in (
        ("gravity", GravityReduction()),
        ("disturbance", DisturbanceReduction()),
    ):
        message = made.heard[f"gravimeter/{name}"][0]
        value, variance = adapter_of(made.scenario, name).read_reduced(message)
        expected = reduction.reduce(SENSED, State(*HERE, 100.0, 12.0, 15.0))
        assert value == pytest.approx(float(expected), abs=1e-15)
        assert variance > 1e-10 + (0.1 * 3.086e-6) ** 2  # sensor, height, and more


def test_without_navigator_the_scan_is_known_to_be_empty(scenario) -> None:
    with bench(topics.GRAVIMETER, scenario(), simulate=False) as made:
        made.nav(1.0, *HERE)
        made.nav(90.0, *HERE)
        made.reading(10.0, SENSED, topic=topics.GRAVIMETRY)
        assert math.isnan(made.heard["gravimeter/gravity"][0].accel.accel.linear.z)
        assert made.told("said nothing about 10.000 s")


def test_after_a_reset_time_may_begin_anew(scenario) -> None:
    with bench(topics.GRAVIMETER, scenario(), simulate=False) as made:
        for round in range(2):
            for k in range(1, 4):
                made.reading(10.0 * k, SENSED + 1e-6 * k, topic=topics.GRAVIMETRY)
                made.nav(10.0 * k, *HERE)
            assert stamps(made, topics.GRAVITY) == [10, 20, 30] * (round + 1)
            assert made.call("reset", Trigger.Request()).success


def test_it_simulates_readings_at_its_scans_only(scenario) -> None:
    with bench(topics.GRAVIMETER, scenario()) as made:
        message = topics.TRUTH_FIX.type()
        for k in range(1, 25):
            message.header.stamp.sec = k
            made.publish(topics.TRUTH_FIX, message)
        assert stamps(made, topics.GRAVIMETRY) == [10, 20]


def test_a_magnetometers_readings_are_reduced(magnetic) -> None:
    main_field = float(intensity(*np.degrees(PLACE), 100.0, 2025.0))
    total = main_field + 321.0
    with bench(topics.GRAVIMETER, magnetic, simulate=False) as made:
        vector = 0.6 * total, 0.0, -0.8 * total
        made.publish(topics.MAGNETIC_FIELD, field_of(10.0, vector, variance=9.0))
        made.nav(10.0, *PLACE)
        made.publish(topics.MAGNETIC_FIELD, field_of(20.0, (0.0, total, 0.0)))
        made.nav(20.0, *PLACE)
        known, unknown = made.heard["magnetometer/anomaly"]
        assert known.magnetic_field.z * 1e9 == pytest.approx(321.0, abs=0.02)
        assert known.header.frame_id == "main_field"
        # the sensor's, and the main field's gradient over the navigator's 30 m
        variances = [message.magnetic_field_covariance[8] * 1e18 for message in (known, unknown)]
        assert 9.0 < variances[0] < 9.1
        # where it is unknown, gravimeter.sigma of 2 nT
        assert variances[1] - 4.0 == pytest.approx(variances[0] - 9.0)
        assert not made.heard["gravimeter/gravity"]


def test_a_clearance_meters_readings_are_reduced(terrain) -> None:
    with bench(topics.GRAVIMETER, terrain, simulate=False) as made:
        for seconds, message in (
            (10.0, range_of(10.0, 70.0, variance=4.0)),
            (20.0, range_of(20.0, math.inf)),
        ):
            made.publish(topics.CLEARANCE, message)
            made.nav(seconds, *PLACE)
        ground, nothing = made.heard["altimeter/terrain"]
        assert ground.altitude == pytest.approx(30.0)  # the navigator is at 100 m
        # and its height is good to 0.1 m
        assert ground.position_covariance[8] == pytest.approx(4.0 + 0.01)
        assert [ground.latitude, ground.longitude] == pytest.approx(np.degrees(PLACE))
        assert math.isnan(nothing.altitude)
        level, _, figures = made.says()[-1]
        assert (level, figures["readings out of range"]) == (OK, "1")
        assert not made.node.health.dropped


def test_bad_messages_are_dropped_and_said(magnetic) -> None:
    """What is bad of a message, tests of its reader say."""
    with bench(topics.GRAVIMETER, magnetic, simulate=False) as made:
        for seconds, said, value in ((10, 10, 5e4), (20, 5, 5e4), (30, 30, 5e4)):
            made.publish(topics.MAGNETIC_FIELD, field_of(said, (0, 0, value)))
            made.nav(seconds, *PLACE)
        assert len(made.heard["magnetometer/anomaly"]) == 2
        level, text, figures = made.told("not later than")
        assert (level, figures["dropped magnetometer/data_raw"]) == (WARN, "1")
        assert "magnetometer/data_raw" in text


def test_a_gradiometers_readings_are_reduced(gradient) -> None:
    place = np.radians([-36.5, 147.0])
    normal = normal_gradient(place[0], 100.0)
    with bench(topics.GRAVIMETER, gradient, simulate=False) as made:
        felt = [normal[0, 1] + 4e-8, normal[0, 2] - 2e-8, math.nan]
        made.publish(topics.FULL_GRADIENT, vector_reading(gradient, 10.0, felt))
        made.nav(10.0, *place)
        made.publish(topics.FULL_GRADIENT, vector_reading(gradient, 20.0, [math.nan] * 3))
        made.nav(20.0, *place)
        read = adapter_of(made.scenario).read_reduced
        value, covariance = read(made.heard["gradiometer/gradient"][0])
        np.testing.assert_allclose(value, [4e-8, -2e-8, math.nan], atol=1e-14)
        np.testing.assert_array_equal(covariance, 1e-18 * np.eye(3))
        assert np.isnan(read(made.heard["gradiometer/gradient"][1])[0]).all()
        assert made.says()[-1][2]["readings out of range"] == "1"


@pytest.mark.parametrize(("speed", "stuck"), [(0.1, False), (12.0, True)])
def test_an_instrument_is_stuck_only_where_the_vehicle_moves(scenario, speed, stuck) -> None:
    """Of a car that waits each reading is that of before."""
    _, made = gravity_of(scenario(), [SENSED] * 9, (speed, 0.0))
    assert any("stuck: " in text for _, text, _ in made.says()) == stuck


@pytest.mark.parametrize(("noise", "empty"), [(range(8), 1), ([0, 0, 1, 1, 2, 2, 3, 3, 4], 0)])
def test_a_reading_that_comes_again_as_none_has_before_is_let_go(scenario, noise, empty) -> None:
    """From the first repetition on, unless the instrument's steps are as coarse as that."""
    found, made = gravity_of(scenario(), [SENSED + 1e-5 * n for n in (*noise, noise[-1], 10)])
    assert [k for k, value in enumerate(found) if math.isnan(value)] == [len(noise)] * empty
    assert made.node.health.figures["readings repeated"] == empty
    assert not any("stuck: " in text for _, text, _ in made.says())


def test_one_stamp_far_ahead_is_dropped_and_several_are_a_gap(scenario) -> None:
    with bench(topics.GRAVIMETER, scenario(), simulate=False) as made:
        for k, second in enumerate((10, 3600, 20, 30, 500, 510)):
            made.reading(second, SENSED + 1e-6 * k, topic=topics.GRAVIMETRY)
            if second in (10, 20, 30, 510):
                made.nav(second, *HERE)
        assert stamps(made, topics.GRAVITY) == [10, 20, 30, 510]
        assert made.node.health.dropped == {topics.GRAVIMETRY.name: 2}
        made.told("used if the next one is, too")
