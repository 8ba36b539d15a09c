"""The node isogal_mavlink: nav/odom to a flight controller, and its sensors to the graph, by
datagrams."""

import socket
from collections.abc import Sequence
from types import ModuleType
from typing import Any, ClassVar, Literal

from diagnostic_msgs.msg import DiagnosticArray
from pydantic import Field
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import NavSatFix, NavSatStatus, PointCloud2

from isogal.errors import InputError
from isogal.sensors.scans import Thinning
from isogal_ros import topics
from isogal_ros.mavlink.decoding import PATIENCE, ROWS, Receiver
from isogal_ros.mavlink.destination import Destination, host_and_port
from isogal_ros.mavlink.encoding import (
    GPS_INPUT,
    VISION,
    global_position_sensor,
    gps_input,
    require_usable,
    vision_position_estimate,
)
from isogal_ros.messages.fix_information import read_fix_information
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.odometry import read_odometry
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import OK, WARN, figures_of
from isogal_ros.nodes.settings import NodeSettings
from isogal_ros.nodes.spin import main_of

LIKELY = 0.5
"""Probability from which on the navigator is taken to be somewhere else."""


class MavlinkSettings(NodeSettings):
    """Own parameters of isogal_mavlink."""

    address: str = Field(
        "127.0.0.1:14550",
        description="host:port that takes MAVLink 2 by UDP, a router or autopilot",
    )
    message: Literal["", "GPS_INPUT", "VISION_POSITION_ESTIMATE", "GLOBAL_POSITION_SENSOR"] = (
        Field("GPS_INPUT", description="what is sent; empty = nothing but heartbeats")
    )
    receive: str = Field(
        "",
        description=(
            "host:port at which messages of the vehicle's sensors are taken, and published on the"
            " graph's topics; empty = none"
        ),
    )
    sensors: tuple[str, ...] = Field(
        ("HIGHRES_IMU", "SCALED_PRESSURE", "GPS_RAW_INT"),
        description=f"messages that are taken, one for each topic; of {', '.join(ROWS)}",
    )
    rate: float = Field(5.0, gt=0.0, le=50.0, description="most messages a second, Hz")
    system_id: int = Field(1, ge=1, le=255, description="of the vehicle")
    component_id: int = Field(
        197, ge=1, le=255, description="of this node; 197 = visual inertial odometry"
    )
    satellites: int = Field(
        10, ge=0, le=255, description="satellites_visible of GPS_INPUT, as the autopilot wants it"
    )


MAVLINK = "isogal_mavlink"
EARLY = 0.05
"""Of the interval between messages, by which one may come before its time: stamps jitter."""


class MavlinkNode(GraphNode[MavlinkSettings]):
    """Sends each nav/odom, up to a rate; nothing while the navigator is lost."""

    sections: ClassVar[Sequence[str]] = ("seed", "route", "field", "gravimeter")
    settings_model: ClassVar[type[NodeSettings]] = MavlinkSettings

    def setup(self) -> None:
        """Open the socket and make subscriptions."""
        self._dialect = _dialect()
        self._to = Destination(*host_and_port("address", self.settings.address))
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        # without it a datagram to all of a network is refused
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._mavlink = self._dialect.MAVLink(
            None, self.settings.system_id, self.settings.component_id
        )
        self._frame = map_frame(self.scenario)
        self._lost = self._found = self._elsewhere = self._aligned = False
        """Whether the navigator was lost, there has been a fix since, it is probably at another
        place, and it is aligned."""
        self._fixed, self._resets = -1, 0
        """Stamp of the last message on nav/fix, and how often the position has jumped."""
        self._pace = Thinning(from_seconds(1.0 / self.settings.rate), EARLY)
        self._receiver: Receiver | None = None
        if self.settings.receive:
            at = host_and_port("receive", self.settings.receive)
            self._receiver = Receiver(self, self._dialect, at)
        if not self.settings.message:
            return
        self.listen(topics.INFORMATION, self._take_information)
        self.listen(topics.DIAGNOSTICS, self._take_diagnostics)
        self.listen(topics.NAV_FIX, self._take_fix)
        self.listen(topics.NAV_ODOM, self._take_odometry, raw=True)
        self._heard = self.monotonic()
        self.watch("without the navigator", self._unheard)

    def _unheard(self) -> str | None:
        """Say that the navigator's state does not come; None = it does."""
        silent = self.monotonic() - self._heard
        if silent <= PATIENCE:
            return None
        return f"nothing on {topics.NAV_ODOM.name}, so nothing is sent: is the navigator running?"

    def _take_information(self, message: PointCloud2) -> None:
        fix = read_fix_information(message).fix
        self._lost = self._lost or fix.reset
        self._found = self._lost and fix.published

    def _take_diagnostics(self, array: DiagnosticArray) -> None:
        own = f"{self.get_namespace()}/{topics.PMHT_MM}: batch".lstrip("/")
        for item in array.status:
            if item.name == own:
                self._elsewhere = float(figures_of(item).get("diverged", "0")) > LIKELY

    def _take_fix(self, message: NavSatFix) -> None:
        ns = to_ns(message.header.stamp)
        self._aligned = message.status.status != NavSatStatus.STATUS_NO_FIX
        if ns == self._fixed and self._found:  # the second of a stamp is after a fix
            self._lost = self._found = False
            self._resets += 1
        self._fixed = ns

    def _take_odometry(self, data: bytes) -> None:
        odometry = read_odometry(data)
        self._heard = self.monotonic()
        self.health.stamp = odometry.ns
        if self._lost or self._elsewhere or not self._aligned:
            why = "is not aligned" if not (self._lost or self._elsewhere) else "has diverged"
            self.health.state(WARN, f"silent: the navigator {why}")
            return
        require_usable(odometry)
        if not self._pace.takes(odometry.ns):
            return
        own = self.settings
        if own.message == GPS_INPUT:
            made = gps_input(self._dialect, odometry, self._frame, own.satellites)
        elif own.message != VISION:
            field = self.scenario.measured_field
            made = global_position_sensor(self._dialect, odometry, self._frame, field)
        else:
            made = vision_position_estimate(self._dialect, odometry, self._resets)
        self._send(made)
        self.health.count("sent")
        self.health.state(OK, "sending")

    def _send(self, message: Any) -> None:
        if self._to.address is None:
            self.health.concern("sending", f"{self.settings.address}: {self._to.why}")
            return
        try:
            # the sequence number is that of this sender
            self._socket.sendto(message.pack(self._mavlink), self._to.address)
            self._mavlink.seq = (self._mavlink.seq + 1) % 256
            self.health.concern("sending", None)
        except OSError as error:
            self.health.concern("sending", f"{self.settings.address}: {error.strerror or error}")

    def _beat(self) -> None:
        if self.active:  # HEARTBEAT: onboard controller, no autopilot, active
            self._send(self._dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        super()._beat()

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the sockets as well: the port is to be had again."""
        self._close_sockets()
        return super().on_cleanup(state)

    def destroy_node(self) -> None:
        """Close the sockets as well."""
        self._close_sockets()
        super().destroy_node()

    def _close_sockets(self) -> None:
        for name in ("_to", "_socket", "_receiver"):
            if (one := getattr(self, name, None)) is not None:
                one.close()


def _dialect() -> ModuleType:
    """Return pymavlink's messages; raises InputError where it is not installed."""
    try:
        from pymavlink.dialects.v20 import common
    except ImportError:
        common = None
    if not hasattr(common, "MAVLink_global_position_sensor_message"):
        raise InputError(
            f"{MAVLINK} needs the Python package pymavlink, 2.4.50 or later: pip install"
            " isogal[mavlink]"
        )
    return common


main = main_of(MavlinkNode, MAVLINK)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
