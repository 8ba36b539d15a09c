"""The datagrams of a flight controller, published on the graph's topics."""

import socket
from types import ModuleType
from typing import TYPE_CHECKING

from isogal.errors import InputError
from isogal_ros.mavlink.decoding import ROWS, Received, Row, SenderClock, time_of
from isogal_ros.messages.checks import BadMessageError

if TYPE_CHECKING:
    from isogal_ros.mavlink.settings import MavlinkSettings
    from isogal_ros.nodes.base import GraphNode

PERIOD = 0.005
"""s between looks at the socket. Stamps are the sender's, so this is latency and no error."""
_MOST = 1000
"""Datagrams at one look."""
_LARGEST = 65535


class Receiver:
    """Takes messages of one system at a port, and publishes those that are wanted.

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
        self._wanted = {name: _row(name) for name in node.settings.sensors}
        publish = [topic for row in self._wanted.values() for topic in row.topics]
        if len(set(publish)) < len(publish):
            raise InputError("sensors: two of them are for one topic; name one")
        self._publishers = {topic: node.advertise(topic) for topic in publish}
        self._clock = SenderClock()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(at)
        except OSError as error:
            self.close()
            raise InputError(f"receive: {at[0]}:{at[1]}: {error.strerror or error}") from None
        self._socket.setblocking(False)
        node.create_timer(PERIOD, self._look)

    def _look(self) -> None:
        for _ in range(_MOST):
            try:
                data = self._socket.recv(_LARGEST)
            except OSError:  # nothing more
                return
            for found in self._decoder.parse_buffer(data) or ():
                if found.get_type() in self._wanted and found.get_srcSystem() == self._system:
                    self._take(found)

    def _take(self, found: Received) -> None:
        if not self._node.active:
            return
        row = self._wanted[found.get_type()]
        now = self._node.now_ns()
        try:
            for topic, message in row.decode(found, self._clock.stamp(time_of(found), now)):
                self._publishers[topic].publish(message)
        except BadMessageError as error:
            self._node.health.drop(row.topics[0].name, str(error))
            return
        self._node.health.count("received")

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _row(name: str) -> Row:
    if name not in ROWS:
        raise InputError(f"sensors: must be of {', '.join(ROWS)}, not {name!r}")
    return ROWS[name]
