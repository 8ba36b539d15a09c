"""Where datagrams go."""

import ipaddress
import socket
import threading

from isogal.errors import InputError

AGAIN = 30.0
"""s between look-ups of a host's name: it may get another address."""


class Destination:
    """A host and its port.

    A name is looked up once, and from then on again and again beside the node: where no server of
    names answers, a look-up takes seconds, in which the node would do nothing else.

    Parameters
    ----------
    host : str
        Its name, or its address.
    port : int
    """

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self.address: tuple[str, int] | None = None
        """None = not known yet."""
        self.why = ""
        """Why it is not."""
        self._closed = threading.Event()
        try:
            ipaddress.ip_address(host)
        except ValueError:
            self._look_up()
            threading.Thread(target=self._keep_looking, daemon=True).start()
        else:
            self.address = host, port

    def _look_up(self) -> None:
        try:
            self.address = socket.gethostbyname(self._host), self._port
        except (OSError, UnicodeError) as error:
            self.why = getattr(error, "strerror", None) or str(error)

    def _keep_looking(self) -> None:
        while not self._closed.wait(AGAIN):
            self._look_up()

    def close(self) -> None:
        """Look up no longer."""
        self._closed.set()


def host_and_port(name: str, text: str) -> tuple[str, int]:
    """Return what a parameter says; raises InputError where it is no ``host:port``."""
    host, _, port = text.rpartition(":")
    if not (host and port.isdecimal() and 0 < int(port) < 65536):
        raise InputError(f"{name}: must be host:port, not {text!r}")
    return host, int(port)
