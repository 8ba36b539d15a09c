"""The faults as data: what fails, how, and for how long."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from builtin_interfaces.msg import Time as Stamp
from geometry_msgs.msg import AccelWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.time import Time
from sensor_msgs.msg import Imu, NavSatFix, PointCloud2

from isogal_ros import topics
from isogal_ros.messages.drivers import field_at, set_field
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.topics import Message, Topic


@dataclass
class Moment:
    """What a fault knows when a message comes."""

    rng: np.random.Generator
    since: float = 0.0
    """s since the fault began."""
    came: list[Message] = field(default_factory=list)
    """The messages of its topic since then, as they came, this one the last."""


Change = Callable[[Message, Moment], Sequence[Message]]
"""Turns a message, which is its own, into those that come instead."""


@dataclass(frozen=True)
class Fault:
    """One fault."""

    name: str
    targets: tuple[str, ...]
    """What fails: one source of messages (`topics_of`), or nodes."""
    effect: Change | str
    """Of messages, what they become; of nodes: killed (started again with its checkpoint), begun
    anew (without it), stopped, or slow (stopped half of the time)."""
    lasts: float = 60.0
    """s."""
    matters: bool = True
    """Whether it must be reported within two batches; else it may be too small to be seen."""

    def is_on(self, elapsed: float, turn: float = math.inf) -> bool:
        """Whether it acts at a time (s) after its begin; slow nodes go again every other turn."""
        within = 0.0 <= elapsed < self.lasts
        return within and not (self.effect == "slow" and elapsed // turn % 2)


def topics_of(source: str, readings: tuple[Topic, ...]) -> tuple[Topic, ...]:
    """Return the topics of a source of messages (none of a node); `readings` are those of the
    instruments."""
    found = {
        "imu": (topics.IMU,),
        "reading": readings,
        "fix": (topics.FIX, topics.INFORMATION),
        "information": (topics.INFORMATION,),
        "nav": (topics.NAV_FIX, topics.NAV_ODOM),
    }
    return found.get(source, ())


_VALUES = {
    Imu: "linear_acceleration.x",
    AccelWithCovarianceStamped: "accel.accel.linear.z",
    NavSatFix: "latitude",
    Odometry: "pose.pose.position.x",
    PointCloud2: "data",
}


def _set(value: object, path: str = "") -> Change:
    """Return what sets a field of a message, by default the number of its type, or all of a whole
    fix: a value, or a function of the old one and the moment."""

    def change(message: Message, moment: Moment) -> Sequence[Message]:
        name = path or _VALUES[type(message)]
        new = value(field_at(message, name), moment) if callable(value) else value
        if name == "data":
            new = np.full(len(message.data) // 8, new).tobytes()
        set_field(message, name, new)
        return [message]

    return change


def _stuck(path: str) -> Change:
    return _set(lambda _, moment: field_at(moment.came[0], path), path)


def _entry(path: str, index: int, number: float) -> Change:
    """Return what changes one entry of a covariance."""
    return _set(lambda old, _: np.where(np.arange(len(old)) == index, number, old), path)


def _shift(seconds: Callable[[Moment], float]) -> Change:
    def shifted(stamp: Stamp, moment: Moment) -> Stamp:
        ns = max(to_ns(stamp) + from_seconds(seconds(moment)), 0)
        return Time(nanoseconds=ns).to_msg()

    return _set(shifted, "header.stamp")


def _once(change: Change) -> Change:
    return lambda message, moment: change(message, moment) if len(moment.came) == 1 else [message]


def _copies(count: int) -> Change:
    return lambda message, _: [message] * count


def _every_second(message: Message, moment: Moment) -> Sequence[Message]:
    return [message] if len(moment.came) % 2 else []


def _of(source: str, lasts: float, *more: tuple[str, Change, *tuple[float, ...]]) -> list[Fault]:
    """Return the faults that messages of every source may have, and more of one source: name,
    effect, and how long it lasts (s) and whether it matters, where that is not as usual."""
    every: tuple[tuple[str, Change, *tuple[float, ...]], ...] = (
        ("NaN", _set(math.nan)),
        ("infinite", _set(math.inf)),
        ("wrong frame", _set("camera", "header.frame_id")),
        ("stamps of zero", _set(Stamp(), "header.stamp")),
    )
    return [
        Fault(f"{source} {name}", (source,), change, *(rest or (lasts,)))
        for name, change, *rest in every + more
    ]


_FORCE, _RATE = "linear_acceleration", "angular_velocity"
_FORCE_VARIANCE, _VARIANCE = ("linear_acceleration_covariance", 0), ("accel.covariance", 14)
ANSWERING = (topics.GRAVIMETER, topics.PMHT_MM, topics.UKF_FUSION)
"""The nodes that answer the sensors."""
_SEVERAL = {"filter and matcher": ANSWERING[1:], "all that answer": ANSWERING}
FAULTS = (
    *_of(
        "imu",
        60.0,
        ("absurd", _set(1e6)),
        ("spike of 100 m/s²", _once(_set(100.0))),
        ("spike of 0.2 m/s²", _once(_set(0.2))),
        ("negative variance", _entry(*_FORCE_VARIANCE, -2.0)),
        ("marked as absent", _entry(*_FORCE_VARIANCE, -1.0)),
        ("stamps back", _shift(lambda m: -100.0)),
        ("one stamp ahead", _once(_shift(lambda m: 3600.0))),
        ("stamps jitter", _shift(lambda m: m.rng.uniform(-0.2, 0.2)), 60.0, False),
        ("every sample twice", _copies(2)),
        ("half the rate", _every_second),
        ("outage of 5 s", _copies(0), 5.0),
        ("outage of 60 s", _copies(0)),
        ("outage of 180 s", _copies(0), 180.0),
        ("accelerometers stuck", _stuck(_FORCE), 120.0),
        ("gyroscopes stuck", _stuck(_RATE), 120.0),
        ("dead gyroscope", _set(0.0, f"{_RATE}.z"), 120.0),
        ("dead gyroscope x", _set(0.0, f"{_RATE}.x"), 120.0),
        ("stuck gyroscope", _stuck(f"{_RATE}.z"), 120.0),
        ("dead accelerometer", _set(0.0, f"{_FORCE}.x"), 120.0),
        ("stuck accelerometer", _stuck(f"{_FORCE}.y"), 120.0),
        ("saturated accelerometer", _set(lambda old, _: min(old, 9.0), f"{_FORCE}.z"), 120.0),
        ("saturated gyroscope", _set(4.0, f"{_RATE}.z"), 120.0),
        ("accelerometer drift", _set(lambda old, m: old + 1e-5 * m.since), 60.0, False),
    ),
    *_of(
        "reading",
        60.0,
        ("absurd", _set(1e6)),
        ("of zero", _set(0.0)),
        ("spike of 200 mGal", _once(_set(lambda old, m: old + 2e-3)), 60.0, False),
        ("negative variance", _entry(*_VARIANCE, -1.0)),
        ("absurd variance", _entry(*_VARIANCE, 1e12), 60.0, False),
        ("infinite variance", _entry(*_VARIANCE, math.inf)),
        ("stamps back", _shift(lambda m: -100.0)),
        ("stamps jitter", _shift(lambda m: m.rng.uniform(-0.4, 0.4)), 60.0, False),
        ("every one twice", _copies(2)),
        ("every second one missing", _every_second, 60.0, False),
        ("outage of 30 s", _copies(0), 30.0, False),
        ("outage of 180 s", _copies(0), 180.0),
        ("stuck", _stuck("accel"), 180.0),
        ("drift", _set(lambda old, m: old + 1e-7 * m.since), 60.0, False),
        ("in mGal", _set(lambda old, m: old * 1e5)),
        ("of the other sign", _set(lambda old, m: -old)),
        ("50 mGal too large", _set(lambda old, m: old + 5e-4), 60.0, False),
    ),
    *_of(
        "fix",
        300.0,
        ("stamps ahead", _shift(lambda m: 3600.0), 300.0, False),
        ("every one twice", _copies(2), 300.0, False),
        ("one batch late", lambda _, m: m.came[-2:-1], 300.0, False),
        ("lost", _copies(0), 300.0, False),
    ),
    Fault("fix without its information", ("information",), _copies(0), 300.0, False),
    *_of(
        "nav",
        60.0,
        ("every message twice", _copies(2), 60.0, False),
        ("lost for 60 s", _copies(0)),
    ),
    *(
        # a few seconds cost the filter samples, and the others hardly anything
        Fault(f"{who} killed for {s:.0f} s", nodes, "killed", s, s > 5.0 or ANSWERING[2] in nodes)
        for who, nodes in ({name: (name,) for name in ANSWERING} | _SEVERAL).items()
        for s in (5.0, 60.0)
    ),
    *(Fault(f"{n} begun anew after 5 s", (n,), "begun anew", 5.0, False) for n in ANSWERING[:2]),
    *(Fault(f"{name} stopped for 60 s", (name,), "stopped", 60.0, False) for name in ANSWERING),
    *(Fault(f"{name} slow", (name,), "slow", 180.0, False) for name in ANSWERING),
)
QUICK = (
    "imu NaN", "imu one stamp ahead", "imu outage of 60 s", "imu dead gyroscope",
    "reading in mGal", "nav NaN", "ukf_fusion_node killed for 5 s",
)  # fmt: skip
"""Those of a quick campaign."""
