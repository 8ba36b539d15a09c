"""Messages that are serialised once say the same as those that rclpy serialises each time."""

import struct

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message

from isogal_ros import topics
from isogal_ros.messages.prepared import Prepared, Reader, numbers_of, peek_ns, serialised, write
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


TODAY = 1_764_187_200_123_456_789


def test_a_message_may_have_the_highest_byte_of_a_number_first() -> None:
    """One of a clock: 7 s and 5 ns, and of three numbers behind a text."""
    assert peek_ns(b"\0\0\0\0" + struct.pack(">iI", 7, 5)) == 7_000_000_005
    assert peek_ns(b"\0\1\0\0" + struct.pack("<iI", 7, 5)) == 7_000_000_005
    content = Reader(b"\0\0\0\0" + struct.pack(">I4s3d", 4, b"odd\0", 1.0, -2.0, 3.0))
    assert content.text() == "odd"
    assert list(content.take("3d")) == [1.0, -2.0, 3.0]


def test_times_in_seconds_are_the_stamps_that_they_were_made_of() -> None:
    stamps = [TODAY + k * 20_000_001 for k in range(100)]
    seconds = [to_seconds(ns) for ns in stamps]
    assert among(reversed(seconds), stamps) == stamps[::-1]
    assert [from_seconds(time) for time in seconds] != stamps  # a float64 is coarser
    assert among([0.25, 2.0], [2_000_000_000]) == [250_000_000, 2_000_000_000]
