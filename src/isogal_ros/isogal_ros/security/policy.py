"""The SROS 2 policy of the graph, generated from its nodes: each may publish and subscribe to what
it does publish and subscribe to, answer its own services, and nothing else.

``python -m isogal_ros.security.policy [PARAMETER_FILE] > policy.xml``; how keys are made of it is
in ``docs/security.md``. The form is that of the policy schema of sros2, version 0.2.0
(https://github.com/ros2/sros2, sros2/sros2/policy/schemas/policy.xsd)."""

import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from isogal.cli.errors import clean_errors
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.bus import Bus, services
from isogal_ros.graph.parameter_files import read_parameters, scenario_of, values_of
from isogal_ros.graph.plan import Plan, nodes_of

ENCLAVES = "/isogal"
COMMON_PUBLISHED = ("rosout", "/parameter_events", "~/transition_event")
PARAMETERS = (
    "describe_parameters", "get_parameter_types", "get_parameters", "get_type_description",
    "list_parameters", "set_parameters", "set_parameters_atomically",
)  # fmt: skip
LIFECYCLE = (
    "change_state", "get_available_states", "get_available_transitions", "get_state",
    "get_transition_graph",
)  # fmt: skip


def endpoints(
    scenario: Scenario, transformed: Collection[str] = ()
) -> dict[str, tuple[set[str], set[str], set[str]]]:
    """Return by node of a graph with a recorder the topics that it publishes, those that it
    listens to, whether sensors are simulated or real, and the services that it answers beside
    those of every node. Some nodes are told by transforms where their sensors are."""
    found: dict[str, tuple[set[str], set[str], set[str]]] = {}
    # what nodes have does not depend on how long the route is
    duration = 2.0 * max(one.gravimeter.interval for one in scenario.each_field)
    route = scenario.route.model_copy(update={"duration": duration})
    short = scenario.model_copy(update={"route": route})
    for real in (False, True):
        with tempfile.TemporaryDirectory() as folder, Bus() as bus:
            plan = Plan(short, Path(folder) / "bag", real=real)
            for name in plan.names:
                node = bus.add(name, plan.values(name))
                published, heard, answered = found.setdefault(name, (set(), set(), set()))
                published |= {relative(one.topic_name) for one in node.publishers}
                heard |= {relative(one.topic_name) for one in node.listening.values()}
                answered |= services(node).keys() - {*PARAMETERS, *LIFECYCLE}
                published -= {relative(one) for one in COMMON_PUBLISHED}
                node.close()
    for name in found.keys() & transformed:
        found[name][1].add("/tf_static")
    return found


def relative(name: str) -> str:
    """Return the name of a topic as a node of the namespace / has given it."""
    absolute = {topic.name for topic in topics.ALL if topic.name.startswith("/")}
    return name if name in absolute else name.lstrip("/")


def policy(scenario: Scenario, transformed: Collection[str] = ()) -> ET.ElementTree:
    """Return the policy of a scenario's graph with a recorder; see `endpoints`."""
    root = ET.Element("policy", version="0.2.0")
    enclaves = ET.SubElement(root, "enclaves")
    for name, (published, heard, answered) in endpoints(scenario, transformed).items():
        enclave = ET.SubElement(enclaves, "enclave", path=f"{ENCLAVES}/{name}")
        profiles = ET.SubElement(enclave, "profiles")
        profile = ET.SubElement(profiles, "profile", ns="/", node=name)
        services = [f"~/{one}" for one in (*PARAMETERS, *LIFECYCLE, *sorted(answered))]
        _allow(profile, "services", "reply", "service", services)
        _allow(profile, "topics", "subscribe", "topic", sorted(heard))
        names = [*COMMON_PUBLISHED, *sorted(published)]
        _allow(profile, "topics", "publish", "topic", names)
    tree = ET.ElementTree(root)
    ET.indent(tree)
    return tree


def _allow(profile: ET.Element, kind: str, what: str, item: str, names: Iterable[str]) -> None:
    allowed = ET.SubElement(profile, kind, {what: "ALLOW"})
    for name in names:
        ET.SubElement(allowed, item).text = name


def policy_of(path: str) -> ET.ElementTree:
    """Return the policy of a parameter file of all nodes; raises InputError."""
    document = read_parameters(path, path)
    scenario = scenario_of({"/**": document.get("/**", {})}, "", path)
    asked = {
        name
        for name in (RECORDER, *nodes_of(scenario))
        for key, value in values_of(document, f"/{name}").items()
        if key.startswith("drivers.") and key.endswith(".from_tf") and value is True
    }
    return policy(scenario, asked)


@clean_errors
def main(words: Sequence[str]) -> None:
    """Print the policy of a parameter file, or of the default scenario."""
    made = policy_of(words[0]) if words else policy(Scenario())
    made.write(sys.stdout, encoding="unicode", xml_declaration=True)
    print(flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
