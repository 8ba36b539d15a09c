"""The whole graph in one process on one executor."""

import time
from collections.abc import Mapping
from typing import Any

from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.domain import graph_domain, local_context, names_of
from isogal_ros.graph.plan import GraphError, Outcome, Plan, node_class
from isogal_ros.graph.progress import Report, ReportTimer, progress_of
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.nodes.spin import drain, make_executor


def run_in_process(plan: Plan, interrupt: Interrupt, report: Report) -> Outcome:
    """Run the graph until the route's end, or until interrupted.

    Raises
    ------
    InputError
        A parameter, map or route cannot be used, or the domain that is asked for.
    GraphError
        A node failed.
    """
    names = names_of(plan.scenario)
    with graph_domain(names, plan.domain) as domain, local_context(domain) as context:
        executor = make_executor(context)
        nodes = {}
        try:
            for name in plan.names:
                nodes[name] = node_class(name)(name, values=plan.values(name), context=context)
                executor.add_node(nodes[name])
            simulator = nodes[topics.INS_SIM]
            begun, timer = time.monotonic(), ReportTimer()
            while not (interrupt or simulator.finished):
                executor.spin_once(timeout_sec=0.2)
                _require_well(nodes)
                if timer.due() and (progress := progress_of(simulator.health.figures)) is not None:
                    report(progress)
            wall = time.monotonic() - (simulator.begun if simulator.step >= 0 else begun)
            simulator.finished = True  # no further step while the recorder takes what is under way
            if RECORDER in nodes:
                drain(nodes[RECORDER], executor)
            _require_well(nodes)
        finally:
            executor.shutdown()  # or it would keep the nodes' publishers
            for node in nodes.values():
                node.close()
        _require_well(nodes)  # the recorder finishes its bag last
        return Outcome(bool(interrupt), wall)


def _require_well(nodes: Mapping[str, Any]) -> None:
    """Raise GraphError where a node has failed."""
    for name, node in nodes.items():
        if node.exit_code:
            raise GraphError(f"{name}: {node.failure}")
