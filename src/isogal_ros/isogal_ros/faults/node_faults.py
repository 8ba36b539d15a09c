"""Faults of nodes in one process: killed and started again, stopped, slow."""

from dataclasses import dataclass
from typing import Literal

from isogal_ros import topics
from isogal_ros.faults.stage import NODES, Stage

TURN = 20.0
"""s that a slow node takes nothing, each time."""


@dataclass(frozen=True)
class NodeFault:
    """One fault of one node, or of several at once, within a time."""

    name: str
    nodes: tuple[str, ...]
    kind: Literal["killed", "begun anew", "stopped", "slow"]
    """killed: started again with its checkpoint; begun anew: without it."""
    lasts: float
    """s of simulated time, which goes on meanwhile."""
    matters: bool = True
    """Whether it must be told within two batches."""


def _faults() -> tuple[NodeFault, ...]:
    several: dict[str, tuple[str, ...]] = {name: (name,) for name in NODES}
    several |= {"filter and matcher": NODES[1:], "all that answer": NODES}
    killed = [
        # a few seconds cost the filter samples, and the others hardly anything
        NodeFault(
            f"{who} killed for {seconds:.0f} s",
            nodes,
            "killed",
            seconds,
            matters=seconds > 5.0 or topics.UKF_FUSION in nodes,
        )
        for who, nodes in several.items()
        for seconds in (5.0, 60.0)
    ]
    anew = [
        NodeFault(f"{name} begun anew after 5 s", (name,), "begun anew", 5.0, matters=False)
        for name in NODES[:2]
    ]
    stopped = [
        NodeFault(f"{name} stopped for 60 s", (name,), "stopped", 60.0, matters=False)
        for name in NODES
    ]
    slow = [NodeFault(f"{name} slow", (name,), "slow", 180.0, matters=False) for name in NODES]
    return (*killed, *anew, *stopped, *slow)


NODE_FAULTS = _faults()


class Mishap:
    """Does a fault to the nodes of a stage.

    Parameters
    ----------
    fault : NodeFault
    begin : float
        s.
    stage : Stage
    """

    def __init__(self, fault: NodeFault, begin: float, stage: Stage) -> None:
        self._fault, self._begin, self._stage = fault, begin, stage
        self._done = self._over = False
        self._since = begin

    def __call__(self, now: float) -> None:
        """Do what is due at a time (s)."""
        if self._over or now < self._begin:
            return
        if not self._done:
            self._done = True
            self._set(True)
        elif now - self._begin >= self._fault.lasts:
            self._over = True
            self._set(False)
        elif self._fault.kind == "slow" and now - self._since >= TURN:
            self._since = now
            self._set(False)
            self._set(True)

    def _set(self, faulty: bool) -> None:
        for name in self._fault.nodes:
            if self._fault.kind in ("killed", "begun anew"):
                if faulty:
                    self._stage.kill(name)
                else:
                    self._stage.start(name, checkpoint=self._fault.kind == "killed")
            elif faulty:
                self._stage.bus.stop(self._stage.nodes[name])
            else:
                self._stage.bus.go(self._stage.nodes[name])
