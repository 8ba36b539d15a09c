"""Faults of sensors and of what nodes tell each other, as what they do to messages within a
time.

A fault turns one message into those that come instead: none, one or several. It may keep what it
needs from one message to the next, and draws from its own random numbers."""

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from isogal_ros import topics
from isogal_ros.messages.stamps import set_stamp, to_ns
from isogal_ros.topics import Topic

SECOND = 1_000_000_000


@dataclass
class Moment:
    """What a fault knows when a message comes."""

    since: float
    """s since the fault began."""
    rng: np.random.Generator
    kept: dict[str, Any]
    """What it keeps."""


Change = Callable[[Any, Moment], list[Any]]
"""Turns a message, which is its own, into others."""


@dataclass(frozen=True)
class Fault:
    """One fault of one sensor, or of the messages between two nodes."""

    name: str
    source: str
    """Whose messages: imu, reading, fix (position and the whole of it), information (the whole
    alone), or nav."""
    change: Change
    matters: bool = True
    """Whether it must be told within two batches; else it may be too small to be seen."""
    lasts: float = 60.0
    """s."""


def _imu(fill: Callable[[Any, Moment], None]) -> Change:
    """A fault of the six numbers of an IMU sample."""
    return _one(fill)


def _one(fill: Callable[[Any, Moment], None]) -> Change:
    def change(message: Any, moment: Moment) -> list[Any]:
        fill(message, moment)
        return [message]

    return change


def _set_force(value: float) -> Change:
    def fill(message: Any, _: Moment) -> None:
        message.linear_acceleration.x = value

    return _one(fill)


def _set_reading(value: float) -> Change:
    def fill(message: Any, _: Moment) -> None:
        message.accel.accel.linear.z = value

    return _one(fill)


def _add_force(of: Callable[[Moment], float]) -> Change:
    def fill(message: Any, moment: Moment) -> None:
        message.linear_acceleration.x += of(moment)

    return _one(fill)


def _add_reading(of: Callable[[Moment], float]) -> Change:
    def fill(message: Any, moment: Moment) -> None:
        message.accel.accel.linear.z += of(moment)

    return _one(fill)


def _scale_reading(factor: float) -> Change:
    def fill(message: Any, _: Moment) -> None:
        message.accel.accel.linear.z *= factor

    return _one(fill)


def _frame(message: Any, _: Moment) -> list[Any]:
    message.header.frame_id = "camera"
    return [message]


def _shift(seconds: Callable[[Moment], float]) -> Change:
    def fill(message: Any, moment: Moment) -> None:
        ns = to_ns(message.header.stamp) + round(seconds(moment) * SECOND)
        set_stamp(message.header.stamp, max(ns, 0))

    return _one(fill)


def _nothing(_message: Any, _moment: Moment) -> list[Any]:
    return []


def _every_second(message: Any, moment: Moment) -> list[Any]:
    moment.kept["count"] = moment.kept.get("count", 0) + 1
    return [message] if moment.kept["count"] % 2 else []


def _twice(message: Any, _: Moment) -> list[Any]:
    return [message, copy.deepcopy(message)]


def _stuck(name: str) -> Change:
    """All numbers of the message's field stay what they were."""

    def change(message: Any, moment: Moment) -> list[Any]:
        first = moment.kept.setdefault("first", copy.deepcopy(getattr(message, name)))
        setattr(message, name, copy.deepcopy(first))
        return [message]

    return change


def _axis(name: str, axis: str, of: Callable[[float, Moment], float]) -> Change:
    """One axis of a vector of an IMU sample is what becomes of its true value."""

    def fill(message: Any, moment: Moment) -> None:
        vector = getattr(message, name)
        setattr(vector, axis, of(getattr(vector, axis), moment))

    return _one(fill)


def _kept(value: float, moment: Moment) -> float:
    return float(moment.kept.setdefault("first", value))


def _below(limit: float) -> Callable[[float, Moment], float]:
    return lambda value, _: min(value, limit)


def _once(change: Change) -> Change:
    def only_first(message: Any, moment: Moment) -> list[Any]:
        if moment.kept.setdefault("done", False):
            return [message]
        moment.kept["done"] = True
        return change(message, moment)

    return only_first


def _covariance(name: str, value: float) -> Change:
    def fill(message: Any, _: Moment) -> None:
        owner = message if hasattr(message, name) else message.accel
        covariance = np.array(getattr(owner, name))
        covariance[0 if owner is message else 14] = value
        setattr(owner, name, covariance)

    return _one(fill)


_FORCE, _RATE = "linear_acceleration", "angular_velocity"
_FORCE_COVARIANCE, _READING = "linear_acceleration_covariance", "covariance"
IMU_FAULTS = (
    Fault("imu NaN", "imu", _set_force(math.nan)),
    Fault("imu infinite", "imu", _set_force(math.inf)),
    Fault("imu absurd", "imu", _set_force(1e6)),
    Fault("imu spike of 100 m/s²", "imu", _once(_set_force(100.0))),
    Fault("imu spike of 0.2 m/s²", "imu", _once(_set_force(0.2))),
    Fault("imu wrong frame", "imu", _frame),
    Fault("imu negative variance", "imu", _covariance(_FORCE_COVARIANCE, -2.0)),
    Fault("imu marked as absent", "imu", _covariance(_FORCE_COVARIANCE, -1.0)),
    Fault("imu stamps back", "imu", _shift(lambda m: -100.0)),
    Fault("imu stamps of zero", "imu", _shift(lambda m: -1e9)),
    Fault("imu one stamp ahead", "imu", _once(_shift(lambda m: 3600.0))),
    Fault("imu stamps jitter", "imu", _shift(lambda m: m.rng.uniform(-0.2, 0.2)), matters=False),
    Fault("imu every sample twice", "imu", _twice),
    Fault("imu half the rate", "imu", _every_second),
    Fault("imu outage of 5 s", "imu", _nothing, lasts=5.0),
    Fault("imu outage of 60 s", "imu", _nothing),
    Fault("imu outage of 180 s", "imu", _nothing, lasts=180.0),
    Fault("imu accelerometers stuck", "imu", _stuck(_FORCE), lasts=120.0),
    Fault("imu gyroscopes stuck", "imu", _stuck(_RATE), lasts=120.0),
    Fault("imu dead gyroscope", "imu", _axis(_RATE, "z", lambda x, m: 0.0), lasts=120.0),
    Fault("imu dead gyroscope x", "imu", _axis(_RATE, "x", lambda x, m: 0.0), lasts=120.0),
    Fault("imu stuck gyroscope", "imu", _axis(_RATE, "z", _kept), lasts=120.0),
    Fault("imu dead accelerometer", "imu", _axis(_FORCE, "x", lambda x, m: 0.0), lasts=120.0),
    Fault("imu stuck accelerometer", "imu", _axis(_FORCE, "y", _kept), lasts=120.0),
    Fault("imu saturated accelerometer", "imu", _axis(_FORCE, "z", _below(9.0)), lasts=120.0),
    Fault("imu saturated gyroscope", "imu", _axis(_RATE, "z", lambda x, m: 4.0), lasts=120.0),
    Fault("imu accelerometer drift", "imu", _add_force(lambda m: 1e-5 * m.since), matters=False),
)
READING_FAULTS = (
    Fault("reading NaN", "reading", _set_reading(math.nan)),
    Fault("reading infinite", "reading", _set_reading(math.inf)),
    Fault("reading absurd", "reading", _set_reading(1e6)),
    Fault("reading of zero", "reading", _set_reading(0.0)),
    Fault("reading spike of 200 mGal", "reading", _once(_add_reading(lambda m: 2e-3)), False),
    Fault("reading wrong frame", "reading", _frame),
    Fault("reading negative variance", "reading", _covariance(_READING, -1.0)),
    Fault("reading absurd variance", "reading", _covariance(_READING, 1e12), matters=False),
    Fault("reading infinite variance", "reading", _covariance(_READING, math.inf)),
    Fault("reading stamps back", "reading", _shift(lambda m: -100.0)),
    Fault("reading stamps of zero", "reading", _shift(lambda m: -1e9)),
    Fault("reading stamps jitter", "reading", _shift(lambda m: m.rng.uniform(-0.4, 0.4)), False),
    Fault("reading every one twice", "reading", _twice),
    Fault("reading every second one missing", "reading", _every_second, matters=False),
    Fault("reading outage of 30 s", "reading", _nothing, matters=False, lasts=30.0),
    Fault("reading outage of 180 s", "reading", _nothing, lasts=180.0),
    Fault("reading stuck", "reading", _stuck("accel"), matters=False, lasts=180.0),
    Fault("reading drift", "reading", _add_reading(lambda m: 1e-7 * m.since), matters=False),
    Fault("reading in mGal", "reading", _scale_reading(1e5)),
    Fault("reading of the other sign", "reading", _scale_reading(-1.0)),
    Fault("reading 50 mGal too large", "reading", _add_reading(lambda m: 5e-4), matters=False),
)


def _late(message: Any, moment: Moment) -> list[Any]:
    """Each message comes with the next of its kind."""
    waiting = moment.kept.setdefault(type(message).__name__, [])
    waiting.append(copy.deepcopy(message))
    return [waiting.pop(0)] if len(waiting) > 1 else []


def _latitude(value: float) -> Change:
    """Numbers of a position, or all of a whole fix, are no numbers."""

    def fill(message: Any, _: Moment) -> None:
        if hasattr(message, "latitude"):
            message.latitude = value
        elif hasattr(message, "data"):
            message.data = np.full(len(message.data) // 8, value).tobytes()
        else:
            message.pose.pose.position.x = value

    return _one(fill)


LINK_FAULTS = (
    Fault("fix NaN", "fix", _latitude(math.nan), lasts=300.0),
    Fault("fix infinite", "fix", _latitude(math.inf), lasts=300.0),
    Fault("fix wrong frame", "fix", _frame, lasts=300.0),
    Fault("fix stamps of zero", "fix", _shift(lambda m: -1e9), lasts=300.0),
    Fault("fix stamps ahead", "fix", _shift(lambda m: 3600.0), matters=False, lasts=300.0),
    Fault("fix every one twice", "fix", _twice, matters=False, lasts=300.0),
    Fault("fix one batch late", "fix", _late, matters=False, lasts=300.0),
    Fault("fix lost", "fix", _nothing, matters=False, lasts=300.0),
    Fault("fix without its information", "information", _nothing, matters=False, lasts=300.0),
    Fault("nav NaN", "nav", _latitude(math.nan)),
    Fault("nav wrong frame", "nav", _frame),
    Fault("nav stamps of zero", "nav", _shift(lambda m: -1e9)),
    Fault("nav every message twice", "nav", _twice, matters=False),
    Fault("nav lost for 60 s", "nav", _nothing),
)
FAULTS = IMU_FAULTS + READING_FAULTS + LINK_FAULTS
QUICK = (
    "imu NaN", "imu one stamp ahead", "imu outage of 60 s", "imu dead gyroscope",
    "reading in mGal", "nav NaN", "ukf_fusion_node killed for 5 s",
)  # fmt: skip
"""Those of a quick campaign."""


def topics_of(fault: Fault, raw: Topic) -> tuple[Topic, ...]:
    """Return the topics that a fault changes; `raw` is that of the instrument."""
    of = {
        "imu": (topics.IMU,),
        "reading": (raw,),
        "fix": (topics.FIX, topics.INFORMATION),
        "information": (topics.INFORMATION,),
        "nav": (topics.NAV_FIX, topics.NAV_ODOM),
    }
    return of[fault.source]
