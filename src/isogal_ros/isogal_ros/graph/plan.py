"""What the ways to run the graph share: which nodes, with which parameters, and what is checked
before the first one starts."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import JsonValue

from isogal.errors import InputError
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import maps_for_scenario
from isogal.fields.simulator import check_readings, check_recorded
from isogal.maps.several import RunMap, each_map
from isogal.matching.registry import build_run_matcher
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.mavlink.node import MAVLINK
from isogal_ros.nodes.base import GraphNode
from isogal_ros.parameters.values import node_values

CLASSES = {
    topics.INS_SIM: ("ins_sim_node.node", "InsSimNode"),
    topics.GRAVIMETER: ("gravimeter_node.node", "GravimeterNode"),
    topics.PMHT_MM: ("pmht_mm_node.node", "PmhtMmNode"),
    topics.UKF_FUSION: ("ukf_fusion_node.node", "UkfFusionNode"),
    RECORDER: ("isogal_ros.bags.recorder", "RecorderNode"),
    MAVLINK: ("isogal_ros.mavlink.node", "MavlinkNode"),
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
    of_recorder: Mapping[str, JsonValue] = field(
        default_factory=lambda: {"closing_time": 20.0, "replace": True}
    )
    """Own parameters of the recorder: it ends last, and must have all of what the others have
    published."""

    @property
    def names(self) -> tuple[str, ...]:
        """Nodes of the graph; the recorder first, so that it hears everything."""
        nodes = nodes_of(self.scenario)
        if self.real:
            nodes = tuple(name for name in nodes if name != topics.INS_SIM)
        return nodes if self.bag is None else (RECORDER, *nodes)

    def own(self, name: str) -> dict[str, JsonValue]:
        """Return the node's own parameters."""
        values: dict[str, JsonValue] = {"run": self.run, "recorders": int(self.bag is not None)}
        fields = instruments_of(self.scenario)
        if len(fields) > 1 or self.real:
            values["peers"] = [one for one in self.names if one != RECORDER]
        if name in fields:
            values |= {"simulate": False} if self.real else {}
            # the scenario of its field in place of all nodes'
            if self.scenario.fields is not None:
                values = node_values(fields[name], values, node_class(name).sections)
        if name == topics.INS_SIM:
            values["rate"] = float(self.rate)
            values |= {} if self.lock_step else {"lock_step": False}
        if name == RECORDER:
            resume = self.checkpoint is not None
            values |= {"bag": str(self.bag), "resume": resume, **self.of_recorder}
        if self.checkpoint is not None:
            values["checkpoint"] = str(self.checkpoint)
        return values

    def values(self, name: str) -> dict[str, JsonValue]:
        """Return all parameters of a node."""
        return node_values(self.scenario, {}, node_class(name).sections) | self.own(name)


class GraphError(RuntimeError):
    """A node of the graph failed; the text is one line that names it."""


def instruments_of(scenario: Scenario) -> dict[str, Scenario]:
    """Return the scenario of each gravimeter_node by its name: one for each field.

    Raises
    ------
    InputError
        Two fields are readings of one instrument, whose topics are the same.
    """
    found: dict[str, Scenario] = {}
    used: dict[str, str] = {}
    for name, one in zip(scenario.field_names, scenario.each_field, strict=True):
        instrument = measured_field(one).instrument
        if instrument in used:
            raise InputError(
                f"fields: {used[instrument]} and {name} are readings of one {instrument}; the"
                " nodes take each instrument once"
            )
        used[instrument] = name
        found[f"{topics.GRAVIMETER}_{name}" if found else topics.GRAVIMETER] = one
    return found


def nodes_of(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the graph's nodes: with several fields, a gravimeter_node for each."""
    return tuple(
        name
        for kind in topics.NODES
        for name in (instruments_of(scenario) if kind == topics.GRAVIMETER else (kind,))
    )


def node_class(name: str) -> type[GraphNode]:
    """Return the class of a node."""
    module, attribute = CLASSES[topics.kind_of(name)]
    return getattr(importlib.import_module(module), attribute)


def checked(scenario: Scenario, simulated: bool = True) -> tuple[Trajectory, RunMap]:
    """Return route and map of a scenario; raises InputError where a node would fail with it.

    Parameters
    ----------
    simulated : bool
        Whether readings are simulated, from the map that `truth` names.
    """
    trajectory = build_trajectory(scenario)
    build_run_matcher(scenario)
    if simulated:
        check_recorded(scenario, trajectory)
    field_map = maps_for_scenario(scenario, trajectory)
    if simulated:
        for one, its_map in zip(scenario.each_field, each_map(field_map), strict=True):
            check_readings(one.true, one.map, trajectory, its_map)
    nodes_of(scenario)
    return trajectory, field_map
