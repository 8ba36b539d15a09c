"""Time stamps as whole nanoseconds."""

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from isogal_ros.messages.stamps import (
    from_ns,
    from_seconds,
    peek_ns,
    set_stamp,
    to_ns,
    to_seconds,
)


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_both_ways(ns) -> None:
    assert to_ns(from_ns(ns)) == ns
    message = Imu()
    set_stamp(message.header.stamp, ns)
    message.header.frame_id = "base_link"
    assert to_ns(message.header.stamp) == ns
    assert peek_ns(serialize_message(message)) == ns


@given(st.floats(0.0, 1e6))
def test_seconds(seconds) -> None:
    assert abs(to_seconds(from_seconds(seconds)) - seconds) <= 1e-9
