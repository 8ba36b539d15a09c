"""ROS domains for tests."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from isogal_ros.graph.domain import free_domains, users_domain


@contextmanager
def claim_domain() -> Iterator[int]:
    """A domain for one graph: that of ``ROS_DOMAIN_ID`` where it is set, else a free one, held
    until the end."""
    with ExitStack() as stack:
        given = users_domain()
        yield next(free_domains(stack)) if given is None else given
