"""What the ways to run the graph share: which nodes, with which parameters, and how a run
ends."""

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.parameters.values import node_values

CLASSES = {
    topics.INS_SIM: ("ins_sim_node.node", "InsSimNode"),
    topics.GRAVIMETER: ("gravimeter_node.node", "GravimeterNode"),
    topics.PMHT_MM: ("pmht_mm_node.node", "PmhtMmNode"),
    topics.UKF_FUSION: ("ukf_fusion_node.node", "UkfFusionNode"),
    RECORDER: ("isogal_ros.bags.recorder", "RecorderNode"),
}
"""Module and class of each node."""


@dataclass(frozen=True)
class Plan:
    """One run of the graph."""

    scenario: Scenario
    bag: Path | None
    """Folder of the recording; None = no recorder."""
    run: int = 0
    rate: float = 0.0
    """Simulated seconds per second; 0 = as fast as the graph can."""
    lock_step: bool = True
    """Whether a step waits for the graph's answers; without, nodes work as they would with real
    sensors."""
    checkpoint: Path | None = None
    """Folder of checkpoints; a node that dies is then started again. None = its end is the
    run's."""

    @property
    def names(self) -> tuple[str, ...]:
        """Nodes of the graph; the recorder first, so that it hears everything."""
        return topics.NODES if self.bag is None else (RECORDER, *topics.NODES)

    def own(self, name: str) -> dict[str, Any]:
        """Return the node's own parameters."""
        values: dict[str, Any] = {"run": self.run, "recorders": int(self.bag is not None)}
        if name == topics.INS_SIM:
            values |= {"rate": float(self.rate), "lock_step": self.lock_step}
        if name == RECORDER:
            if self.checkpoint is not None:
                values |= {"resume": True}
            # it ends last, and must have all of what the others have published
            values |= {"closing_time": 20.0}
            values |= {"bag": str(self.bag), "replace": True}
        if self.checkpoint is not None:
            values |= {"checkpoint": str(self.checkpoint)}
        return values

    def values(self, name: str) -> dict[str, Any]:
        """Return all parameters of a node."""
        return node_values(self.scenario, self.own(name), node_class(name).sections)


@dataclass(frozen=True)
class Outcome:
    """How a run of the graph ended."""

    interrupted: bool
    wall_seconds: float
    """From the first step to the last."""


class GraphError(RuntimeError):
    """A node of the graph failed; the text is one line that names it."""


def node_class(name: str) -> Any:
    """Return the class of a node."""
    module, attribute = CLASSES[name]
    return getattr(importlib.import_module(module), attribute)
