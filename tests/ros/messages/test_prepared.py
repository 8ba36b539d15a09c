"""Messages that are serialised once say the same as those that rclpy serialises each time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rcl_interfaces.msg import ParameterValue
from rclpy.serialization import deserialize_message

from isogal_ros import topics
from isogal_ros.messages.frames import FrameNames
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.prepared import Prepared, numbers_of, serialised, write
from isogal_ros.messages.stamps import among, from_seconds, to_seconds

EACH = (
    topics.CLOCK, topics.IMU, topics.NAV_FIX, topics.NAV_ODOM, topics.NAV_COVARIANCE,
    topics.PROTECTION_LEVEL, topics.POSE,
)  # fmt: skip


def empty(topic, frame: str = "map"):
    message = topic.type()
    if hasattr(message, "header"):
        message.header.frame_id = frame
    return message


def read(topic, message):
    return deserialize_message(serialised(message), topic.type)


@settings(max_examples=50)
@given(
    st.sampled_from(EACH),
    st.text("abc/é", max_size=9),
    st.integers(0, 2**31 * 10**9 - 1),
    st.integers(0, 99),
)
def test_as_rclpy_has_it(topic, frame, ns, seed) -> None:
    plain, prepared = empty(topic, frame), Prepared(empty(topic, frame))
    if topic is topics.CLOCK:
        plain.clock.sec, plain.clock.nanosec = divmod(ns, 10**9)
    for drawn in np.random.default_rng(seed).normal(size=(2, 60)):  # the second overwrites
        several = topic is topics.NAV_COVARIANCE
        numbers = drawn[: len(drawn) if several else len(numbers_of(plain))]
        if len(numbers_of(plain)) > len(drawn):
            numbers = np.resize(drawn, len(numbers_of(plain)))
        for message in (plain, prepared):
            write(message, ns, numbers)
        assert read(topic, prepared) == read(topic, plain)
        np.testing.assert_array_equal(numbers_of(read(topic, prepared)), numbers)


def test_more_numbers_than_before() -> None:
    message = Prepared(topics.NAV_COVARIANCE.type())
    for size in (3, 7, 2):
        write(message, 0, np.arange(float(size)))
        assert list(read(topics.NAV_COVARIANCE, message).data) == list(range(size))


def test_what_is_neither_stamp_nor_number() -> None:
    message = Prepared(empty(topics.NAV_FIX, "base_link"))
    for status in (0, -1, 0):
        fill_fix(message, 5, 0.1, 0.2, 3.0, np.eye(3), status)
        found = read(topics.NAV_FIX, message)
        assert (found.status.status, found.altitude) == (status, 3.0)
        assert found.position_covariance_type == found.COVARIANCE_TYPE_KNOWN
    for _ in range(2):  # the name outside is not taken for one inside
        message.rename(FrameNames(base="map", map="odom").outward)
        assert read(topics.NAV_FIX, message).header.frame_id == "map"
    found = read(topics.NAV_FIX, message)
    assert (found.altitude, found.header.stamp.nanosec) == (3.0, 5)


def test_numbers_that_do_not_follow_one_another() -> None:
    with pytest.raises(ValueError, match="ParameterValue"):
        Prepared(ParameterValue(double_array_value=[0.0]))


TODAY = 1_764_187_200_123_456_789


def test_times_in_seconds_are_the_stamps_that_they_were_made_of() -> None:
    stamps = [TODAY + k * 20_000_001 for k in range(100)]
    seconds = [to_seconds(ns) for ns in stamps]
    assert among(reversed(seconds), stamps) == stamps[::-1]
    assert [from_seconds(time) for time in seconds] != stamps  # a float64 is coarser
    assert among([0.25, 2.0], [2_000_000_000]) == [250_000_000, 2_000_000_000]
