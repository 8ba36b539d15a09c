"""Messages of MAVLink (https://mavlink.io/en/messages/common.html) as messages of the graph.

MAVLink's body axes are forward, right, down."""

import math
import socket
from collections.abc import Callable, Iterator, Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from rclpy.clock import Clock, ClockType
from sensor_msgs.msg import NavSatFix, NavSatStatus

from isogal.errors import InputError
from isogal.scenario.data_sheet import G
from isogal_ros import topics
from isogal_ros.messages.aids import fill_twist
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import ANTENNA, BASE, FRD_FLU, framed
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamps import LAST_STAMP, SECOND
from isogal_ros.topics import Message, Topic

if TYPE_CHECKING:
    from isogal_ros.mavlink.node import MavlinkSettings
    from isogal_ros.nodes.base import GraphNode

_FIX_3D = 3
_BODY_FRD = 12
_UNKNOWN = 65535
"""In the unsigned numbers of GPS_RAW_INT."""
_NOT_MEASURED = -1.0
_MILLI_G = 1e-3 * G
_UNREADABLE = "BAD_DATA", "UNKNOWN_"
"""Begin what pymavlink calls messages that are damaged, or of another dialect."""
_INERTIAL = 0b111111
"""Of HIGHRES_IMU_UPDATED_FLAGS: accelerometers and gyroscopes."""

_UPPER = np.triu_indices(6)
"""Elements of a covariance (6, 6) that MAVLink sends."""
Received: TypeAlias = Any
"""A message as pymavlink decodes it, which has no types."""
Published = Iterator[tuple[Topic, Message]]


def _highres_imu(found: Received, ns: int) -> Published:
    """Yield the sample of a HIGHRES_IMU, m/s² and rad/s."""
    if found.fields_updated & _INERTIAL != _INERTIAL:
        raise BadMessageError("HIGHRES_IMU without new accelerometers or gyroscopes")
    yield from _sample(found, ns, 1.0, 1.0)


def _milli_imu(found: Received, ns: int) -> Published:
    """Yield the sample of a SCALED_IMU, mG and mrad/s; ArduPilot's RAW_IMU has the same units."""
    yield from _sample(found, ns, _MILLI_G, 1e-3)


def _sample(found: Received, ns: int, of_force: float, of_rate: float) -> Published:
    message = framed(topics.IMU, BASE)
    message.orientation_covariance[0] = _NOT_MEASURED
    force = of_force * np.array([found.xacc, found.yacc, found.zacc])
    fill_imu(message, ns, force, of_rate * np.array([found.xgyro, found.ygyro, found.zgyro]))
    yield topics.IMU, message


def _pressure(found: Received, ns: int) -> Published:
    """Yield the absolute pressure of a SCALED_PRESSURE, hPa."""
    message = framed(topics.BAROMETER, BASE, ns)
    message.fluid_pressure = 100.0 * found.press_abs
    yield topics.BAROMETER, message


def _gps(found: Received, ns: int) -> Published:
    """Yield position and horizontal velocity of a GPS_RAW_INT. An accuracy of 0 is not known."""
    message = framed(topics.GNSS_FIX, ANTENNA)
    if found.fix_type < _FIX_3D:
        fill_fix(message, ns, 0.0, 0.0, 0.0, status=NavSatStatus.STATUS_NO_FIX)
        yield topics.GNSS_FIX, message
        return
    covariance = None
    if found.h_acc and found.v_acc:
        covariance = np.diag([1e-3 * found.h_acc, 1e-3 * found.h_acc, 1e-3 * found.v_acc]) ** 2
    place = math.radians(1e-7 * found.lat), math.radians(1e-7 * found.lon)
    fill_fix(message, ns, *place, 1e-3 * (found.alt_ellipsoid or found.alt), covariance)
    if covariance is not None:
        message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
    yield topics.GNSS_FIX, message
    if _UNKNOWN in (found.vel, found.cog):
        return
    velocity, course = framed(topics.GNSS_VELOCITY, ANTENNA), math.radians(1e-2 * found.cog)
    speed, variance = 1e-2 * found.vel, (1e-3 * found.vel_acc) ** 2
    over_ground = speed * np.array([math.sin(course), math.cos(course), math.nan])
    fill_twist(velocity, ns, over_ground, variance)
    yield topics.GNSS_VELOCITY, velocity


def _odometry(found: Received, ns: int) -> Published:
    """Yield the velocity of an ODOMETRY in body axes, for a camera or wheels that measure it."""
    if found.child_frame_id != _BODY_FRD:
        raise BadMessageError("ODOMETRY: child_frame_id must be MAV_FRAME_BODY_FRD")
    message = framed(topics.VELOCITY, BASE)
    fill_twist(message, ns, np.array([found.vx, found.vy, found.vz]) * FRD_FLU)
    upper = np.zeros((6, 6))
    upper[_UPPER] = found.velocity_covariance
    if not np.isnan(upper[0, 0]):
        covariance = (upper + np.triu(upper, 1).T)[:3, :3]
        turned = np.asarray(message.twist.covariance).reshape(6, 6).copy()
        turned[:3, :3] = FRD_FLU[:, None] * covariance * FRD_FLU
        message.twist.covariance = turned.ravel()
    yield topics.VELOCITY, message


ROWS: Mapping[str, tuple[tuple[Topic, ...], Callable[[Received, int], Published]]] = {
    "HIGHRES_IMU": ((topics.IMU,), _highres_imu),
    "RAW_IMU": ((topics.IMU,), _milli_imu),
    "SCALED_IMU": ((topics.IMU,), _milli_imu),
    "SCALED_PRESSURE": ((topics.BAROMETER,), _pressure),
    "GPS_RAW_INT": ((topics.GNSS_FIX, topics.GNSS_VELOCITY), _gps),
    "ODOMETRY": ((topics.VELOCITY,), _odometry),
}
"""By name of MAVLink's message: the topics that it is published on, and what yields their
messages, of a stamp (ns); it raises BadMessageError."""


class SenderClock:
    """Turns times of a sender into stamps.

    Times since 1970 are stamps already. Those since its start are put after the time at which the
    first message came; all messages have that one shift, so that what lies between them is what
    the sender says. A sender that has been started anew gets another."""

    UTC = 1_000_000_000_000_000_000
    """ns since 1970 (of 2001) from which on a time is one since 1970."""
    REBOOT = 5_000_000_000
    """ns by which a time may lie before the newest."""

    def __init__(self) -> None:
        self._shift: int | None = None
        self._newest = 0

    def stamp(self, time: int, now: int) -> int:
        """Return the stamp (ns) of a time (ns) that came at `now` (ns); raises BadMessageError
        where a message cannot have it."""
        if time >= LAST_STAMP:
            raise BadMessageError(f"no such time: {time // SECOND} s")
        if time >= self.UTC:
            return time
        if self._shift is None or time < self._newest - self.REBOOT:
            self._shift, self._newest = now - time, time
        self._newest = max(self._newest, time)
        return time + self._shift


PERIOD = 0.005
"""s between looks at the socket. Stamps are the sender's, so this is latency and no error."""
_MOST = 1000
"""Datagrams at one look."""
_LARGEST = 65535
PATIENCE = 5.0
"""s without a message after which it is missed, or another source of it is used."""


class Receiver:
    """Takes messages of one system at a port, and publishes those that are wanted: of each, those
    of the first source, while it is there.

    Parameters
    ----------
    node : GraphNode
        Its settings say of which system, and which messages.
    dialect : module
        Of pymavlink.
    at : (host, port)

    Raises
    ------
    InputError
        A message is not known, two are for one topic, or the port cannot be had.
    """

    def __init__(
        self, node: "GraphNode[MavlinkSettings]", dialect: ModuleType, at: tuple[str, int]
    ) -> None:
        self._node, self._system = node, node.settings.system_id
        self._decoder = dialect.MAVLink(None)
        self._decoder.robust_parsing = True  # what is damaged is left out, and raises nothing
        for name in node.settings.sensors:
            if name not in ROWS:
                raise InputError(f"sensors: must be of {', '.join(ROWS)}, not {name!r}")
        self._wanted = {name: ROWS[name] for name in node.settings.sensors}
        publish = [topic for of, _ in self._wanted.values() for topic in of]
        if len(set(publish)) < len(publish):
            raise InputError("sensors: two of them are for one topic; name one")
        self._publishers = {topic: node.advertise(topic) for topic in publish}
        self._clock, self._at = SenderClock(), at
        self._used = {name: ("", node.monotonic()) for name in self._wanted}
        """By message, which component and sensor it is of, and when it came last, s of
        `GraphNode.monotonic`."""
        self._others: dict[str, float] = {}
        """When others came last: those of other systems, or that are not wanted."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(at)
        except OSError as error:
            self.close()
            raise InputError(f"receive: {at[0]}:{at[1]}: {error.strerror or error}") from None
        self._socket.setblocking(False)
        # by wall time: the node's clock may be one that only begins with what is received
        node.create_timer(PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        node.watch("without sensors of the autopilot", self._missing)

    def _look(self) -> None:
        for _ in range(_MOST):
            try:
                data = self._socket.recv(_LARGEST)
            except OSError:  # nothing more
                return
            for found in self._decoder.parse_buffer(data) or ():
                name, system = found.get_type(), found.get_srcSystem()
                if name.startswith(_UNREADABLE):
                    continue
                if name in self._wanted and system == self._system:
                    self._take(found)
                else:
                    self._others[f"{name} of system {system}"] = self._node.monotonic()

    def _missing(self) -> str | None:
        """Say which messages do not come, and what comes in their place; None = all come."""
        begin = self._node.monotonic() - PATIENCE
        late = [name for name, (_, time) in self._used.items() if time < begin]
        if not late:
            return None
        others = sorted(name for name, time in self._others.items() if time >= begin)
        return (
            f"receive: {self._at[0]}:{self._at[1]}: no {', '.join(late)} of system {self._system};"
            f" others that come: {', '.join(others) or 'none'}"
        )

    def _take(self, found: Received) -> None:
        if not self._node.active:
            return
        name = found.get_type()
        of, decode = self._wanted[name]
        now, here = self._node.now_ns(), self._node.monotonic()
        source = f"component {found.get_srcComponent()}, id {getattr(found, 'id', 0)}"
        used, last = self._used[name]
        if used not in ("", source) and here - last <= PATIENCE:
            self._node.health.drop(of[0].name, f"{name} of {source}: {used} is used")
            return
        self._used[name] = source, here
        try:
            if hasattr(found, "time_usec"):
                time = int(found.time_usec) * 1000
            else:
                time = int(found.time_boot_ms) * 1_000_000
            for topic, message in decode(found, self._clock.stamp(time, now)):
                self._publishers[topic].publish(message)
        except BadMessageError as error:
            self._node.health.drop(of[0].name, str(error))
            return
        self._node.health.count("received")

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
