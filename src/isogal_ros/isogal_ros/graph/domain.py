"""A ROS domain that no other graph on this machine uses."""

import os
import socket
import sys
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.adapter import topics_in_use
from isogal_ros.nodes.middleware import listening_node, set_profiles

DOMAIN = "ROS_DOMAIN_ID"
DISCOVERY = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
"""Environment of the graph where the user has not said otherwise: found on this machine only."""
_HIGHEST = 101
"""Higher domains use ports that Linux gives to others (the DDSI-RTPS specification's port formula,
section 9.6.2.3)."""
_LARGEST = 232
"""The highest domain whose ports exist."""
_DISCOVERY = 4.0
"""s of wall time after which all who publish in a domain are known. A node finds the others within
0.2 s, but one in eight loses the first answer, which comes again only after three seconds."""
_RESERVED, _GRAPH = "isogal-ros-domain", "isogal-ros-graph"
"""Names that are held: of a domain that is set aside, and of one in which a graph runs."""


def defaults(environment: Mapping[str, str]) -> dict[str, str]:
    """Return what an environment lacks for the graph and says nothing else about."""
    wanted = {**DISCOVERY, **environment}
    set_profiles(wanted)
    return {name: value for name, value in wanted.items() if name not in environment}


@contextmanager
def graph_domain(scenario: Scenario, asked: int | None = None) -> Iterator[int]:
    """Yield a domain for the graph of a scenario, held until its end, in which nobody else
    publishes what the graph does: the one that is asked for, else the user's ``ROS_DOMAIN_ID``,
    else a free one. Where ``ROS_DOMAIN_ID`` is not free of such publishers, it is another one, and
    a line on standard error says so.

    Raises
    ------
    InputError
        The domain that is asked for has a publisher of these topics; or ``ROS_DOMAIN_ID`` is no
        domain.
    """
    used = topics_in_use(scenario)
    # viewers offer to publish initialpose
    names = [topic.name for topic in used if topic is not topics.INITIAL_POSE]
    with ExitStack() as stack:
        given, why = users_domain() if asked is None else asked, None
        if given is not None:
            why = _hold(given, names, stack)
            if why is None:
                yield given
                return
            if asked is not None:
                raise InputError(f"--domain {asked}: {why}; end it, or choose another domain")
        free = (one for one in free_domains(stack) if _hold(one, names, stack) is None)
        domain = next(free, None)
        if domain is None:
            raise InputError(f"no free ROS domain from 1 to {_HIGHEST}; set {DOMAIN}")
        if why is not None:
            said = f"isogal: {DOMAIN}={given}: {why}; taking domain {domain} instead"
            print(said, file=sys.stderr, flush=True)
        yield domain


def users_domain() -> int | None:
    """Return the domain of ``ROS_DOMAIN_ID``, None where it is not set; raises InputError where it
    is no domain."""
    given = os.environ.get(DOMAIN, "")
    if not given:
        return None
    if not given.isdigit() or int(given) > _LARGEST:
        raise InputError(f"{DOMAIN}: must be a number from 0 to {_LARGEST}, not {given!r}")
    return int(given)


def free_domains(stack: ExitStack) -> Iterator[int]:
    """Yield domains that no participant on this machine is in, each set aside until the stack
    ends."""
    start = os.getpid()
    for offset in range(_HIGHEST):
        domain = 1 + (start + offset) % _HIGHEST
        if _claim(_RESERVED, domain, stack) and not participants(domain):
            yield domain


def _hold(domain: int, names: Collection[str], stack: ExitStack) -> str | None:
    """Hold a domain for a graph, or say why it must not run there.

    Two graphs that start at once have no publishers yet: the name that is held keeps them
    apart."""
    with ExitStack() as own:
        if not _claim(_GRAPH, domain, own):
            return "another isogal run is in it"
        if found := _published(domain, names):
            return f"another node in it publishes {found}"
        stack.enter_context(own.pop_all())
    return None


def _published(domain: int, names: Collection[str]) -> str | None:
    """Return a topic of these that has a publisher in a domain; None = there is none."""
    environment = DISCOVERY | os.environ
    here = all(environment[name] == value for name, value in DISCOVERY.items())
    if here and not (environment.get("ROS_STATIC_PEERS") or participants(domain)):
        return None
    with quiet_node(f"isogal_domain_check_{os.getpid()}", domain) as looker:
        end = time.monotonic() + _DISCOVERY
        while time.monotonic() < end:
            time.sleep(0.01)
            if found := next((name for name in names if looker.count_publishers(name)), None):
                return found
    return None


def _claim(kind: str, domain: int, stack: ExitStack) -> bool:
    """Hold a name that only one process can hold: an abstract socket, gone with the process."""
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f"\0{kind}-{domain}")
    except OSError:
        holder.close()
        return False
    stack.callback(holder.close)
    return True


def participants(domain: int) -> int:
    """Count those that listen on this machine: unicast discovery ports are 7410 + 250 domain + 2
    participant, all below those of the next domain and 65536."""
    found, first = 0, 7410 + 250 * domain
    for port in range(first, min(first + 240, 65536), 2):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                found += 1
    return found


@contextmanager
def local_context(domain: int, context: Context | None = None) -> Iterator[Context]:
    """Yield a context in a domain, a new one unless it is given, with `defaults` where the user
    has not said otherwise."""
    os.environ.update(defaults(os.environ))
    context = Context() if context is None else context
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


@contextmanager
def quiet_node(name: str, domain: int) -> Iterator[Node]:
    """Yield a node that only listens, in a context of its own in a domain."""
    with local_context(domain) as context, listening_node(name, context) as node:
        yield node
