"""Time stamps as whole nanoseconds, so that equal times compare equal."""

from collections.abc import Iterable

from builtin_interfaces.msg import Time

SECOND = 1_000_000_000
"""ns."""
LAST_STAMP = 2**31 * SECOND
"""ns from which on a stamp cannot be written: its seconds have 32 bits, with a sign."""


def to_ns(stamp: Time) -> int:
    """Return nanoseconds of a ``builtin_interfaces/Time``."""
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def set_stamp(stamp: Time, ns: int) -> None:
    """Write nanoseconds into a ``builtin_interfaces/Time``."""
    stamp.sec, stamp.nanosec = divmod(ns, SECOND)


def from_seconds(seconds: float) -> int:
    """Return nanoseconds of seconds since the start of a run."""
    return round(seconds * SECOND)


def to_seconds(ns: int) -> float:
    """Return seconds."""
    return ns / SECOND


def among(seconds: Iterable[float], stamps: Iterable[int]) -> list[int]:
    """Return nanoseconds of times in seconds that were made of some of these stamps, to the last:
    at times of today a float is wrong by up to 119 ns."""
    known = {to_seconds(ns): ns for ns in stamps}
    return [known.get(time, from_seconds(time)) for time in seconds]
