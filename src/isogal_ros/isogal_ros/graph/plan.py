"""What the ways to run the graph share: which nodes, with which parameters, and how a run
ends."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from isogal.errors import InputError
from isogal.fields.measured import measured_field
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
    domain: int | None = None
    """ROS domain that must be used; None = as `graph_domain` finds one."""
    real: bool = False
    """Whether the sensors are those of a vehicle or of a recording, and nothing is simulated."""
    of_recorder: ClassVar[Mapping[str, Any]] = {"closing_time": 20.0, "replace": True}
    """Own parameters of the recorder: it ends last, and must have all of what the others have
    published."""

    @cached_property
    def instruments(self) -> dict[str, Scenario]:
        """The scenario of each node that has an instrument, by its name: one for each field.

        Raises
        ------
        InputError
            Two fields are readings of one instrument, whose topics are the same.
        """
        return instruments_of(self.scenario)

    @property
    def names(self) -> tuple[str, ...]:
        """Nodes of the graph; the recorder first, so that it hears everything."""
        nodes = nodes_of(self.scenario)
        if self.real:
            nodes = tuple(name for name in nodes if name != topics.INS_SIM)
        return nodes if self.bag is None else (RECORDER, *nodes)

    def own(self, name: str) -> dict[str, Any]:
        """Return the node's own parameters."""
        values: dict[str, Any] = {"run": self.run, "recorders": int(self.bag is not None)}
        values |= self.of_fields(name)
        if name == topics.INS_SIM:
            values |= {"rate": float(self.rate)}
            values |= {} if self.lock_step else {"lock_step": False}
        if name == RECORDER:
            resume = self.checkpoint is not None
            values |= {"bag": str(self.bag), "resume": resume, **self.of_recorder}
        if self.checkpoint is not None:
            values |= {"checkpoint": str(self.checkpoint)}
        return values

    def of_fields(self, name: str) -> dict[str, Any]:
        """Return what a node is told beside the scenario where there are several fields, or real
        sensors: who else there is, and a node with an instrument the scenario of its field."""
        several = len(self.instruments) > 1
        if not (several or self.real):
            return {}
        own: dict[str, Any] = {"peers": [one for one in self.names if one != RECORDER]}
        if name not in self.instruments:
            return own
        own |= {"simulate": False} if self.real else {}
        scenario = self.instruments[name]
        return node_values(scenario, own, node_class(name).sections) if several else own

    def values(self, name: str) -> dict[str, Any]:
        """Return all parameters of a node."""
        return node_values(self.scenario, {}, node_class(name).sections) | self.own(name)


@dataclass(frozen=True)
class Outcome:
    """How a run of the graph ended."""

    interrupted: bool
    wall_seconds: float
    """From the first step to the last."""


class GraphError(RuntimeError):
    """A node of the graph failed; the text is one line that names it."""


def instruments_of(scenario: Scenario) -> dict[str, Scenario]:
    """Return the scenario of each gravimeter_node by its name; see `Plan.instruments`."""
    found: dict[str, Scenario] = {}
    used: dict[str, str] = {}
    for field, one in zip(scenario.field_names, scenario.each_field, strict=True):
        instrument = measured_field(one).instrument
        if instrument in used:
            raise InputError(
                f"fields: {used[instrument]} and {field} are readings of one {instrument}; the"
                " nodes take each instrument once"
            )
        used[instrument] = field
        found[f"{topics.GRAVIMETER}_{field}" if found else topics.GRAVIMETER] = one
    return found


def nodes_of(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the graph's nodes: with several fields, a gravimeter_node for each."""
    return tuple(
        name
        for kind in topics.NODES
        for name in (instruments_of(scenario) if kind == topics.GRAVIMETER else (kind,))
    )


def node_class(name: str) -> Any:
    """Return the class of a node."""
    module, attribute = CLASSES[topics.kind_of(name)]
    return getattr(importlib.import_module(module), attribute)
