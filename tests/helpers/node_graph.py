"""What a node publishes, hears and answers."""

import time
from typing import Any

from helpers.domains import claim_domain
from isogal_ros.graph.domain import local_context
from isogal_ros.graph.plan import node_class

ATTEMPTS, PATIENCE = 4, 15.0
"""Participants that are tried for a node, and s that each is waited for."""

Names = tuple[set[str], ...]


def names_of(name: str, values: dict[str, Any], expected: Names) -> Names:
    """Names of topics published and heard, and of services, of a node in a participant of its
    own. Discovery sometimes misses endpoints for good, in a process with many participants before
    it nearly always: then once more, in another participant."""
    for _ in range(ATTEMPTS):
        with claim_domain() as domain, local_context(domain) as context:
            node = node_class(name)(name, values=values, context=context)
            try:
                found = _wait(node, name, expected)
            finally:
                node.close()
        if found == expected:
            break
    return found


def _wait(node: Any, name: str, expected: Names) -> Names:
    """What there is when the graph's discovery, which runs beside this thread, has had time to
    see it."""
    asks = (
        node.get_publisher_names_and_types_by_node,
        node.get_subscriber_names_and_types_by_node,
        node.get_service_names_and_types_by_node,
    )
    end = time.monotonic() + PATIENCE
    while True:
        found = tuple({topic for topic, _ in ask(name, "/")} for ask in asks)
        if found == expected or time.monotonic() > end:
            return found
        time.sleep(0.05)
