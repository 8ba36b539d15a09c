"""A ROS domain that no other graph on this machine uses."""

import gc
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from isogal.errors import InputError

DOMAIN = "ROS_DOMAIN_ID"
DISCOVERY = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
"""Environment of the graph where the user has not said otherwise: found on this machine only."""
_PROFILES = {
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(Path(__file__).with_name("fastdds.xml")),
    "RMW_FASTRTPS_USE_QOS_FROM_XML": "1",
}
"""Quick acknowledgements, and memory that is freed. The second is for the first only: with a file
that does not say how messages are kept it would mean something else than usual."""
_OWN_FILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_HIGHEST = 101
"""Higher domains use ports that Linux gives to others (the DDSI-RTPS specification's port formula,
section 9.6.2.3)."""


def defaults(environment: Mapping[str, str]) -> dict[str, str]:
    """Return what an environment lacks for the graph and says nothing else about."""
    wanted = dict(DISCOVERY)
    file = _PROFILES[_OWN_FILES[0]]
    if all(environment.get(name, file) == file for name in _OWN_FILES):
        wanted |= _PROFILES
    return {name: value for name, value in wanted.items() if name not in environment}


@contextmanager
def claim_domain() -> Iterator[int]:
    """Yield a domain for one graph: the user's ``ROS_DOMAIN_ID`` where it is set, else a free one,
    held until the end.

    A domain counts as free where nobody listens on the first participants' ports and no other run
    holds it.

    Raises
    ------
    InputError
        ``ROS_DOMAIN_ID`` is no domain.
    """
    given = os.environ.get(DOMAIN, "")
    if given:
        if not given.isdigit() or int(given) > 232:
            raise InputError(f"{DOMAIN}: must be a number from 0 to 232, not {given!r}")
        yield int(given)
        return
    with ExitStack() as stack:
        start = os.getpid()
        for offset in range(_HIGHEST):
            domain = 1 + (start + offset) % _HIGHEST
            if _claim(domain, stack) and not _in_use(domain):
                yield domain
                return
        raise InputError(f"no free ROS domain from 1 to {_HIGHEST}; set {DOMAIN}")


def _claim(domain: int, stack: ExitStack) -> bool:
    """Hold a name that only one process can hold: an abstract socket, gone with the process."""
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f"\0isogal-ros-domain-{domain}")
    except OSError:
        holder.close()
        return False
    stack.callback(holder.close)
    return True


def _in_use(domain: int) -> bool:
    """Whether a participant listens: unicast discovery ports are 7410 + 250 domain + 2
    participant."""
    for participant in range(4):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7410 + 250 * domain + 2 * participant))
            except OSError:
                return True
    return False


@contextmanager
def local_context(domain: int) -> Iterator[Context]:
    """Yield a context in a domain, with `defaults` where the user has not said otherwise."""
    os.environ.update(defaults(os.environ))
    context = Context()
    # without log files, which would go to the user's home folder, and without lines between
    # those of the command
    arguments = ["--ros-args", "--disable-external-lib-logs", "--log-level", "warn"]
    rclpy.init(
        args=arguments,
        context=context,
        domain_id=domain,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    try:
        yield context
    finally:
        context.try_shutdown()
        # nodes are in cycles of references, and until they are collected others see them
        gc.collect()
