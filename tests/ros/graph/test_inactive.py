"""A node that is deactivated counts for the lock-step as one that is gone, until it is activated
again."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from helpers.domains import claim_domain
from isogal_ros import topics
from isogal_ros.graph.domain import local_context
from isogal_ros.graph.plan import Plan, node_class
from isogal_ros.nodes.health import WARN
from isogal_ros.nodes.spin import make_executor

PATIENCE = 60.0


class Graph:
    """The nodes of a graph in this process, and what the simulator has logged."""

    def __init__(self, plan: Plan, context: Any) -> None:
        self.executor, self.nodes = make_executor(context), {}
        for name in plan.names:
            self.nodes[name] = node_class(name)(name, values=plan.values(name), context=context)
            self.executor.add_node(self.nodes[name])
        self.simulator = self.nodes[topics.INS_SIM]
        self.logged: list[tuple[bytes, str]] = []
        log = self.simulator.health._log

        def note(level: bytes, text: str) -> None:
            self.logged.append((level, text))
            log(level, text)

        self.simulator.health._log = note

    def spin(self, condition: Callable[[], Any], what: str) -> None:
        """Spin until a condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert not self.simulator.exit_code, self.simulator.failure
            assert time.monotonic() < end, f"waited in vain for {what}"
            self.executor.spin_once(timeout_sec=0.05)

    def steps(self, count: int, what: str) -> None:
        """Spin until some more steps have come."""
        last = self.simulator.step + count
        self.spin(lambda: self.simulator.step >= last, what)


def forgotten(graph: Graph) -> int:
    """How many steps were not waited for."""
    return int(graph.simulator.health.figures.get("steps not waited for", 0))


@pytest.fixture(scope="module")
def graph(scenario) -> Iterator[Graph]:
    # longer than all tests take together: how many steps pass while one waits is by chance
    plan = Plan(scenario("route.duration=1900.0"), None)
    with claim_domain() as domain, local_context(domain) as context:
        made = Graph(plan, context)
        try:
            yield made
        finally:
            made.executor.shutdown()
            for node in made.nodes.values():
                node.close()
            made.executor.shutdown()


@pytest.mark.parametrize("name", [topics.GRAVIMETER, topics.PMHT_MM, topics.UKF_FUSION])
def test_the_simulation_goes_on_without_it_and_with_it_again(graph, name) -> None:
    before = forgotten(graph)
    node, words = graph.nodes[name], f"goes on without {name}, which is not active"
    graph.steps(70, "the first steps")
    node.trigger_deactivate()
    graph.steps(30, f"steps without {name}")
    if name == topics.GRAVIMETER:  # one that is configured anew has other publishers
        node.trigger_cleanup()
        node.trigger_configure()
        graph.steps(30, f"steps without {name}")
    assert graph.logged.count((WARN, words)) == 1
    assert node.health.figures["ready"] is False
    assert forgotten(graph) <= before + 1
    node.trigger_activate()
    health = graph.simulator.health
    lock_step = graph.simulator.lock_step
    graph.spin(lambda: not (health._concerns or lock_step.changed), f"the answers of {name}")
    # as long as it lasts until all have found their way back, and no step is let go any more
    graph.steps(70, f"steps with {name}")
    before = forgotten(graph)  # none where the news was there in time
    graph.steps(130, f"whole batches with {name}")
    assert forgotten(graph) == before
    assert not lock_step.absent()
    if name != topics.GRAVIMETER:  # configured anew it looks for its listeners anew
        assert node.health.figures["ready"] is True
