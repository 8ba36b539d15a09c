"""The faults as data: what fails, how, and for how long."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import TypeAlias, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Accel, AccelWithCovarianceStamped, Vector3
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, NavSatFix, PointCloud2

from isogal.arrays import Array
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.messages.stamps import from_ns, from_seconds, to_ns
from isogal_ros.topics import Topic

Message: TypeAlias = Imu | AccelWithCovarianceStamped | NavSatFix | Odometry | PointCloud2
Kept: TypeAlias = Message | Vector3 | Accel | float
"""What a fault may keep of a message: all of it, or a field."""
T = TypeVar("T")


@dataclass
class Moment:
    """What a fault knows when a message comes."""

    since: float
    """s since the fault began."""
    rng: np.random.Generator
    first: Kept | None = None
    """What it keeps of the first message that came."""
    last: dict[str, Message] = field(default_factory=dict)
    """The last message by the name of its type."""
    count: int = 0
    """Of messages that came."""


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
    """s of simulated time; of processes of wall time."""
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


def _field(path: str, of: Callable[[T, Moment], T]) -> Change:
    """What becomes of one field of a message."""
    *owners, name = path.split(".")

    def change(message: Message, moment: Moment) -> Sequence[Message]:
        owner = reduce(getattr, owners, message)
        setattr(owner, name, of(getattr(owner, name), moment))
        return [message]

    return change


_VALUES = {
    Imu: "linear_acceleration.x",
    AccelWithCovarianceStamped: "accel.accel.linear.z",
    NavSatFix: "latitude",
    Odometry: "pose.pose.position.x",
}


def _value(of: Callable[[float, Moment], float]) -> Change:
    """One number of a message by its type, or all of a whole fix."""

    def every(data: bytes, moment: Moment) -> bytes:
        return np.full(len(data) // 8, of(0.0, moment)).tobytes()

    def change(message: Message, moment: Moment) -> Sequence[Message]:
        if isinstance(message, PointCloud2):
            return _field("data", every)(message, moment)
        return _field(_VALUES[type(message)], of)(message, moment)

    return change


def _entry(path: str, index: int, number: float) -> Change:
    """One entry of a covariance."""

    def entry(old: Array, _: Moment) -> Array:
        return np.where(np.arange(len(old)) == index, number, old)

    return _field(path, entry)


def _constant(value: T) -> Callable[[T, Moment], T]:
    return lambda _old, _moment: value


def _first(value: Kept, moment: Moment) -> Kept:
    moment.first = value if moment.first is None else moment.first
    return moment.first


def _at_most(limit: float) -> Callable[[float, Moment], float]:
    return lambda old, _moment: min(old, limit)


def _shift(seconds: Callable[[Moment], float]) -> Change:
    def stamp(old: Time, moment: Moment) -> Time:
        return from_ns(max(to_ns(old) + from_seconds(seconds(moment)), 0))

    return _field("header.stamp", stamp)


def _once(change: Change) -> Change:
    return lambda message, moment: (
        change(message, moment) if _first(message, moment) is message else [message]
    )


def _copies(count: int) -> Change:
    return lambda message, _moment: [message] * count


def _every_second(message: Message, moment: Moment) -> Sequence[Message]:
    moment.count += 1
    return [message] if moment.count % 2 else []


def _late(message: Message, moment: Moment) -> Sequence[Message]:
    """Each message comes with the next of its type."""
    kind = type(message).__name__
    before, moment.last[kind] = moment.last.get(kind), message
    return [] if before is None else [before]


def _of(
    source: str, lasts: float, *more: tuple[str, Change, *tuple[float, ...]]
) -> tuple[Fault, ...]:
    """Return the faults that messages of every source may have, and more of one source: name,
    effect, and how long it lasts (s) and whether it matters, where that is not as usual."""
    every: tuple[tuple[str, Change, *tuple[float, ...]], ...] = (
        ("NaN", _value(_constant(math.nan))),
        ("infinite", _value(_constant(math.inf))),
        ("wrong frame", _field("header.frame_id", _constant("camera"))),
        ("stamps of zero", _field("header.stamp", _constant(Time()))),
    )
    return tuple(
        Fault(f"{source} {name}", (source,), change, *(rest or (lasts,)))
        for name, change, *rest in every + more
    )


_FORCE, _RATE = "linear_acceleration", "angular_velocity"
_FORCE_VARIANCE, _VARIANCE = ("linear_acceleration_covariance", 0), ("accel.covariance", 14)
MESSAGE_FAULTS = (
    *_of(
        "imu",
        60.0,
        ("absurd", _value(_constant(1e6))),
        ("spike of 100 m/s²", _once(_value(_constant(100.0)))),
        ("spike of 0.2 m/s²", _once(_value(_constant(0.2)))),
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
        ("accelerometers stuck", _field(_FORCE, _first), 120.0),
        ("gyroscopes stuck", _field(_RATE, _first), 120.0),
        ("dead gyroscope", _field(f"{_RATE}.z", _constant(0.0)), 120.0),
        ("dead gyroscope x", _field(f"{_RATE}.x", _constant(0.0)), 120.0),
        ("stuck gyroscope", _field(f"{_RATE}.z", _first), 120.0),
        ("dead accelerometer", _field(f"{_FORCE}.x", _constant(0.0)), 120.0),
        ("stuck accelerometer", _field(f"{_FORCE}.y", _first), 120.0),
        ("saturated accelerometer", _field(f"{_FORCE}.z", _at_most(9.0)), 120.0),
        ("saturated gyroscope", _field(f"{_RATE}.z", _constant(4.0)), 120.0),
        ("accelerometer drift", _value(lambda old, m: old + 1e-5 * m.since), 60.0, False),
    ),
    *_of(
        "reading",
        60.0,
        ("absurd", _value(_constant(1e6))),
        ("of zero", _value(_constant(0.0))),
        ("spike of 200 mGal", _once(_value(lambda old, m: old + 2e-3)), 60.0, False),
        ("negative variance", _entry(*_VARIANCE, -1.0)),
        ("absurd variance", _entry(*_VARIANCE, 1e12), 60.0, False),
        ("infinite variance", _entry(*_VARIANCE, math.inf)),
        ("stamps back", _shift(lambda m: -100.0)),
        ("stamps jitter", _shift(lambda m: m.rng.uniform(-0.4, 0.4)), 60.0, False),
        ("every one twice", _copies(2)),
        ("every second one missing", _every_second, 60.0, False),
        ("outage of 30 s", _copies(0), 30.0, False),
        ("outage of 180 s", _copies(0), 180.0),
        ("stuck", _field("accel", _first), 180.0, False),
        ("drift", _value(lambda old, m: old + 1e-7 * m.since), 60.0, False),
        ("in mGal", _value(lambda old, m: old * 1e5)),
        ("of the other sign", _value(lambda old, m: -old)),
        ("50 mGal too large", _value(lambda old, m: old + 5e-4), 60.0, False),
    ),
    *_of(
        "fix",
        300.0,
        ("stamps ahead", _shift(lambda m: 3600.0), 300.0, False),
        ("every one twice", _copies(2), 300.0, False),
        ("one batch late", _late, 300.0, False),
        ("lost", _copies(0), 300.0, False),
    ),
    Fault("fix without its information", ("information",), _copies(0), 300.0, False),
    *_of(
        "nav",
        60.0,
        ("every message twice", _copies(2), 60.0, False),
        ("lost for 60 s", _copies(0)),
    ),
)
ANSWERING = (topics.GRAVIMETER, topics.PMHT_MM, topics.UKF_FUSION)
"""The nodes that answer the sensors."""
_SEVERAL = {"filter and matcher": ANSWERING[1:], "all that answer": ANSWERING}
NODE_FAULTS = (
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
FAULTS = MESSAGE_FAULTS + NODE_FAULTS
"""Those within one process."""
_EVERY = (RECORDER, *topics.NODES)
PROCESS_FAULTS = (
    *(Fault(f"{name} killed", (name,), "killed", 1.0, name in ANSWERING) for name in _EVERY),
    *(Fault(f"{name} stopped for 3 s", (name,), "stopped", 3.0, False) for name in _EVERY),
    *(Fault(f"{name} at half speed", (name,), "slow", 5.0, False) for name in _EVERY),
    *(Fault(f"{who} killed", nodes, "killed", 1.0) for who, nodes in _SEVERAL.items()),
)
QUICK = (
    "imu NaN", "imu one stamp ahead", "imu outage of 60 s", "imu dead gyroscope",
    "reading in mGal", "nav NaN", "ukf_fusion_node killed for 5 s",
)  # fmt: skip
"""Those of a quick campaign."""
