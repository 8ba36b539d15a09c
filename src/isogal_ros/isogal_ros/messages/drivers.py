"""Messages as drivers and other packages publish them, turned into the graph's own.

A node, or the reader of a recording, passes every message of a sensor through an `Entrance`. What
it can do is a table (`FORMS`): which vectors and numbers a type of the graph has, that turn and
scale, and its frame; in which other units its numbers may come; and which other types are taken in
its place.

What cannot be seen in a message (unit, mounting, a frame of another name) is said by the parameter
`drivers`, an entry for each topic (`Driver`)."""

import json
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property, reduce
from typing import Any

import numpy as np
from geometry_msgs.msg import (
    AccelStamped,
    AccelWithCovarianceStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    TwistStamped,
    TwistWithCovarianceStamped,
    Vector3Stamped,
)
from nav_msgs.msg import Odometry
from pydantic import BaseModel, ConfigDict, JsonValue
from rclpy.serialization import serialize_message
from sensor_msgs.msg import FluidPressure, Imu, LaserScan, MagneticField, PointCloud2, Range
from std_msgs.msg import Float32, Float64

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.inertial.rotations import from_angles, from_matrix, matrix
from isogal.scenario import validated
from isogal_ros import topics
from isogal_ros.messages.altimeter import FAN
from isogal_ros.messages.checks import ABSENT
from isogal_ros.messages.frames import BASE, MAP, FrameNames
from isogal_ros.messages.gravimeter import PLATFORM
from isogal_ros.messages.prepared import decoded
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.topics import Message, Topic, type_name

_NONE = 1e-9
"""Share of an axis in another below which they have nothing in common."""


Triple = tuple[float, float, float]


class Driver(BaseModel):
    """How the messages of a topic come, where that is not as the graph has them."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    frame: str | None = None
    """of its messages, in place of the graph's own; empty = any; null = the graph's own"""
    rotation: Triple | None = None
    """roll, pitch, yaw of the sensor's axes in those of the graph's frame (REP-103), deg, as in a
    static transform or a URDF's rpy; null = none"""
    translation: Triple | None = None
    """where the sensor is in the graph's frame, x, y, z in m, as in a static transform or a URDF's
    xyz; counts where the scenario has no lever arm (`mounting`)"""
    from_tf: bool = False
    """whether the two are those of /tf_static where they are not given"""
    unit: str = ""
    """of its numbers; empty = SI"""

    @cached_property
    def turn(self) -> Array:
        """Rotation (3, 3) from the sensor's axes to the frame's."""
        # about x, then y, then z, as heading, pitch and roll are in other axes
        return matrix(from_angles(*np.radians(self.rotation or (0.0, 0.0, 0.0))))


Copy = Callable[[Message, Message], None]
"""Copies a message of another type into one of the graph."""


@dataclass(frozen=True)
class Form:
    """What a type of the graph holds, and how it may come; names of fields are dotted."""

    frame: str | None
    """In which its readers want it; None = in any."""
    vectors: tuple[tuple[str, str], ...] = ()
    """Vectors, and the covariance of each, whose first three rows are its own."""
    numbers: tuple[tuple[str, int], ...] = ()
    """Numbers, and by which power of the unit they go."""
    units: Mapping[str, float] = field(default_factory=dict)
    """SI in each unit that it may come in."""
    others: Mapping[type[Message], Copy] = field(default_factory=dict)
    """Types that may come in its place."""


def _number(copy: Copy) -> dict[type[Message], Copy]:
    """Return the types that are a number, and what copies it."""
    return {Float64: copy, Float32: copy}


def _copy(source: str, target: str) -> Copy:
    """Return what copies a field to a field."""
    return lambda given, made: set_field(made, target, field_at(given, source))


def _distance(given: Float64, made: Range) -> None:
    """Copy a distance; what is not positive is nothing in range (REP 117)."""
    made.max_range = math.inf
    made.range = float(given.data) if given.data > 0.0 else math.inf


def _bearing(given: Float64, made: Imu) -> None:
    """Copy a heading, degrees from north over east, as the orientation of a level vehicle."""
    half = math.radians(0.5 * (90.0 - given.data))
    made.orientation.w, made.orientation.z = math.cos(half), math.sin(half)


def _odometry_twist(given: Odometry, made: TwistWithCovarianceStamped) -> None:
    """Copy a velocity, which is in the child's frame."""
    made.twist, made.header.frame_id = given.twist, given.child_frame_id


FORMS: Mapping[type[Message], Form] = {
    Imu: Form(
        BASE,
        (
            ("linear_acceleration", "linear_acceleration_covariance"),
            ("angular_velocity", "angular_velocity_covariance"),
        ),
        others=_number(_bearing),
    ),
    AccelWithCovarianceStamped: Form(
        PLATFORM,
        (("accel.accel.linear", "accel.covariance"),),
        units={"m/s2": 1.0, "mGal": 1e-5, "Gal": 1e-2, "um/s2": 1e-6},
        others={
            **_number(_copy("data", "accel.accel.linear.z")),
            AccelStamped: _copy("accel", "accel.accel"),
            Vector3Stamped: _copy("vector", "accel.accel.linear"),
            Imu: _copy("linear_acceleration", "accel.accel.linear"),
        },
    ),
    TwistWithCovarianceStamped: Form(
        BASE,
        (("twist.twist.linear", "twist.covariance"),),
        units={"m/s": 1.0, "kn": 1852.0 / 3600.0, "km/h": 1.0 / 3.6},
        others={
            TwistStamped: _copy("twist", "twist.twist"),
            Vector3Stamped: _copy("vector", "twist.twist.linear"),
            Odometry: _odometry_twist,
        },
    ),
    MagneticField: Form(
        None,
        (("magnetic_field", "magnetic_field_covariance"),),
        units={"T": 1.0, "nT": 1e-9, "uT": 1e-6, "mT": 1e-3, "G": 1e-4},
        others={
            **_number(_copy("data", "magnetic_field.z")),
            Vector3Stamped: _copy("vector", "magnetic_field"),
        },
    ),
    FluidPressure: Form(
        None,
        numbers=(("fluid_pressure", 1), ("variance", 2)),
        units={"Pa": 1.0, "hPa": 1e2, "mbar": 1e2, "kPa": 1e3, "dbar": 1e4, "bar": 1e5},
        others=_number(_copy("data", "fluid_pressure")),
    ),
    Range: Form(
        None,
        numbers=(("range", 1), ("min_range", 1), ("max_range", 1), ("variance", 2)),
        units={"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048},
        others=_number(_distance),
    ),
    PoseWithCovarianceStamped: Form(
        MAP, others={PoseStamped: _copy("pose", "pose.pose"), Odometry: _copy("pose", "pose")}
    ),
    PointCloud2: Form(BASE),
    LaserScan: Form(FAN),
}
"""By type of the graph; of others nothing is known but that their frame may be any."""


def _form(topic: Topic) -> Form:
    return FORMS.get(topic.type, Form(None))


def type_taken(topic: Topic, names: Collection[str]) -> type[Message] | None:
    """Return the topic's own type if it is among some types, given by their ROS names, else the
    first that the topic takes in its place; None = none of them."""
    if type_name(topic.type) in names:
        return topic.type
    others = {type_name(kind): kind for kind in _form(topic).others}
    return next((others[name] for name in names if name in others), None)


@dataclass(frozen=True)
class Entrance:
    """What messages pass on their way in.

    Raises
    ------
    InputError
        An entry names no topic that sensors publish, or no unit of it, or asks for what is not
        done with its messages.
    """

    drivers: Mapping[str, Driver] = field(default_factory=dict)
    """By topic."""
    names: FrameNames = field(default_factory=FrameNames)

    def __post_init__(self) -> None:
        known = [topic for topic in topics.ALL if topic.single]
        for name, driver in self.drivers.items():
            topic = topics.topic_named(name, known, "drivers")
            if driver.from_tf and not driver.frame:
                raise InputError(f"drivers.{name}.from_tf: needs `frame`, which is looked up")
            form = _form(topic)
            if driver.unit not in ("", *form.units):
                allowed = f"one of {', '.join(form.units)}" if form.units else "empty"
                raise InputError(f"drivers.{name}.unit: must be {allowed}, not {driver.unit!r}")
            if driver.frame and driver == Driver(frame=driver.frame) and form.frame is None:
                raise InputError(
                    f"drivers.{name}.frame: has no effect, messages of any frame are taken;"
                    " with `from_tf: true` the sensor's place is that of the frame"
                )
            if any(driver.rotation or ()) and form.frame == BASE and not form.vectors:
                raise InputError(
                    f"drivers.{name}.rotation: its messages are not turned, their axes must be"
                    f" those of {self.names.outside(BASE)!r}"
                )

    def text(self) -> str:
        """Return what a recording keeps of it."""
        drivers = {name: one.model_dump() for name, one in self.drivers.items()}
        return json.dumps({"drivers": drivers, "names": asdict(self.names)})

    @classmethod
    def of(cls, text: str, others: Mapping[str, Mapping[str, JsonValue]]) -> "Entrance":
        """Return what a text of a recording says, with other entries in place of its own; raises
        InputError where it is damaged, or an entry cannot be used."""
        try:
            document = json.loads(text)
            entries = {**document["drivers"], **others}
            names = FrameNames(**document["names"])
        except (ValueError, KeyError, TypeError):
            raise InputError("drivers: what the recording says of them is damaged") from None
        drivers = {
            name: validated(Driver, one, f"drivers.{name}.") for name, one in entries.items()
        }
        return cls(drivers, names)

    def changes(self, topic: Topic) -> bool:
        """Whether messages of the topic's own type come in otherwise than as they are."""
        return topic.name in self.drivers or self.names != FrameNames()

    def take(self, topic: Topic, message: Message, received: int) -> Message:
        """Return a message of the topic's own type, in its frame, axes and units.

        Parameters
        ----------
        received : int
            When it came, ns: the stamp of a message that has none.
        """
        driver = self.drivers.get(topic.name, Driver())
        form = _form(topic)
        size = form.units.get(driver.unit, 1.0)
        if type(message) is not topic.type:
            message = _converted(topic, message, received, form)
        if topic.name in self.drivers:
            _adjust(message, form, driver, size)
        self.names.inward(message)
        return message

    def take_serialised(self, topic: Topic, data: bytes, kind: str, received: int) -> bytes:
        """Return what `take` returns, serialised.

        Parameters
        ----------
        data : bytes
            The message, serialised.
        kind : str
            ROS name of its type.
        received : int
            As of `take`.
        """
        taken = type_taken(topic, (kind,)) or topic.type
        if taken is topic.type and not self.changes(topic):
            return data
        message = decoded(data, taken)
        return bytes(serialize_message(self.take(topic, message, received)))


def _converted(topic: Topic, given: Message, received: int, form: Form) -> Message:
    """Return a message of the topic's type with what one of another type says."""
    made = topic.type()
    made.header.frame_id = form.frame or ""
    set_stamp(made.header.stamp, received)
    if hasattr(given, "header"):
        made.header = given.header
    form.others[type(given)](given, made)
    return made


def _adjust(message: Message, form: Form, driver: Driver, size: float) -> None:
    """Bring a message into the frame, the axes and the units of the graph."""
    if driver.frame is not None and form.frame is not None:
        if driver.frame not in ("", message.header.frame_id):
            return  # which its reader refuses
        message.header.frame_id = form.frame
    turned = any(driver.rotation or ())
    if turned or size != 1.0:
        for name, of_covariance in form.vectors:
            _transform(message, name, of_covariance, driver.turn, size)
        for name, power in form.numbers:
            setattr(message, name, getattr(message, name) * size**power)
    if turned and isinstance(message, Imu):
        q = message.orientation
        if (quaternion := np.array([q.w, q.x, q.y, q.z])).any():
            turn = matrix(quaternion) @ driver.turn.T
            q.w, q.x, q.y, q.z = from_matrix(turn).tolist()


def _transform(message: Message, name: str, of_covariance: str, turn: Array, size: float) -> None:
    """Turn and scale a vector and its covariance. An axis that has a part in one that is not
    measured (variance -1, or NaN) is not measured either."""
    vector, whole = field_at(message, name), field_at(message, of_covariance)
    width = math.isqrt(len(whole))
    covariance = np.array(whole, dtype=float).reshape(width, width)
    own = covariance[:3, :3]
    if width == 3 and own[0, 0] == ABSENT:  # all of it, in messages of sensor_msgs
        own = np.zeros((3, 3))
    absent = np.diag(own) == ABSENT
    given = np.array([vector.x, vector.y, vector.z])
    own = np.where(absent[:, None] | absent, 0.0, own)
    turned = size * (turn @ np.where(absent, 0.0, given))
    own = size**2 * (turn @ own @ turn.T)
    absent = (np.abs(turn) > _NONE) @ absent
    own[absent, absent] = ABSENT
    vector.x, vector.y, vector.z = turned.tolist()
    if width > 3 or covariance[0, 0] != ABSENT:
        covariance[:3, :3] = own
    set_field(message, of_covariance, covariance.ravel())


def field_at(message: Message, path: str) -> Any:
    """Return a field by its dotted name."""
    return reduce(getattr, path.split("."), message)


def set_field(message: Message, path: str, value: Any) -> None:
    """Set a field by its dotted name."""
    *outer, last = path.split(".")
    setattr(reduce(getattr, outer, message), last, value)
