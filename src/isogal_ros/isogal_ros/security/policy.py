"""The SROS 2 policy of the graph, generated from its nodes: each may publish and subscribe to what
it does publish and subscribe to, answer its own services, and nothing else.

``python -m isogal_ros.security.policy [PARAMETER_FILE] > policy.xml``; how keys are made of it is
in ``docs/security.md``. The form is that of the policy schema of sros2, version 0.2.0
(https://github.com/ros2/sros2, sros2/sros2/policy/schemas/policy.xsd)."""

import sys
import tempfile
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Collection, Sequence
from pathlib import Path

from isogal.cli.errors import clean_errors
from isogal.scenario import Scenario
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.bus import Bus, services
from isogal_ros.graph.parameter_files import ParameterFile
from isogal_ros.graph.plan import Plan, nodes_of

ENCLAVES = "/isogal"
REPLY, SUBSCRIBE, PUBLISH = (
    ("services", "reply", "service"),
    ("topics", "subscribe", "topic"),
    ("topics", "publish", "topic"),
)
"""Elements of a profile, what each allows, and those of the names in it."""
COMMON = {
    REPLY: {"~/get_type_description"},
    PUBLISH: {"/rosout", "/parameter_events", "~/transition_event"},
}
"""What every node has of rcl itself."""


def policy(scenario: Scenario, transformed: Collection[str] = ()) -> ET.ElementTree:
    """Return the policy of a scenario's graph with a recorder, whether sensors are simulated or
    real. Some nodes are told by transforms where their sensors are."""
    found: defaultdict[str, defaultdict[tuple[str, str, str], set[str]]]
    found = defaultdict(lambda: defaultdict(set, {what: set(of) for what, of in COMMON.items()}))
    # what nodes have does not depend on how long the route is
    duration = 2.0 * max(one.gravimeter.interval for one in scenario.each_field)
    route = scenario.route.model_copy(update={"duration": duration})
    short = scenario.model_copy(update={"route": route})
    for real in (False, True):
        with tempfile.TemporaryDirectory() as folder, Bus() as bus:
            plan = Plan(short, Path(folder) / "bag", real=real)
            for name in plan.names:
                node, allowed = bus.add(name, plan.values(name)), found[name]
                allowed[PUBLISH] |= {one.topic_name for one in node.publishers}
                allowed[SUBSCRIBE] |= {one.topic_name for one in node.listening.values()}
                allowed[SUBSCRIBE] |= {"/tf_static"} if name in transformed else set()
                allowed[REPLY] |= {f"~/{one}" for one in services(node)}
                node.close()
    root = ET.Element("policy", version="0.2.0")
    enclaves = ET.SubElement(root, "enclaves")
    for name, allowed in found.items():
        enclave = ET.SubElement(enclaves, "enclave", path=f"{ENCLAVES}/{name}")
        profiles = ET.SubElement(enclave, "profiles")
        profile = ET.SubElement(profiles, "profile", ns="/", node=name)
        for kind, what, item in (REPLY, SUBSCRIBE, PUBLISH):
            part = ET.SubElement(profile, kind, {what: "ALLOW"})
            for each in sorted(allowed[kind, what, item]):
                ET.SubElement(part, item).text = each
    tree = ET.ElementTree(root)
    ET.indent(tree)
    return tree


def policy_of(path: str) -> ET.ElementTree:
    """Return the policy of a parameter file of all nodes; raises InputError."""
    file = ParameterFile.read(path, path)
    scenario = file.of_all.scenario("")
    asked = {
        name
        for name in (RECORDER, *nodes_of(scenario))
        for key, value in file.values(f"/{name}").items()
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
