"""The SROS 2 policy of the graph, generated from its topics: each node may publish and subscribe
to what it does publish and subscribe to, answer its own services, and nothing else.

``python -m isogal_ros.security.policy > policy.xml``; how keys are made of it is in
``docs/security.md``. The form is that of the policy schema of sros2, version 0.2.0
(https://github.com/ros2/sros2, sros2/sros2/policy/schemas/policy.xsd)."""

import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable

from isogal.fields.measured import measured_field, of_instrument
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.plan import instruments_of, nodes_of
from isogal_ros.messages.adapter import Adapter, adapter_of, topics_in_use
from isogal_ros.topics import Topic

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
RESETTABLE = (topics.PMHT_MM, topics.UKF_FUSION)
NAVIGATION = (topics.NAV_FIX, topics.NAV_ODOM, topics.NAV_COVARIANCE)


def published(name: str, scenario: Scenario) -> set[Topic]:
    """Return the topics of the graph that a node publishes."""
    if (one := instruments_of(scenario).get(name)) is not None:
        of = [
            adapter_of(one, field.name) for field in of_instrument(measured_field(one).instrument)
        ]
        raw_and_reduced = {topic for a in of for topic in (a.raw, a.reduced)}
        return {*raw_and_reduced, *_beside(adapter_of(one)), topics.DIAGNOSTICS}
    own: dict[str, Iterable[Topic]] = {
        topics.INS_SIM: (
            topics.CLOCK, topics.IMU, topics.TRUTH_FIX, topics.TRUTH_ODOM, topics.INS_FIX,
        ),
        topics.PMHT_MM: (topics.FIX, topics.INFORMATION, topics.POSE, topics.CANDIDATES),
        topics.UKF_FUSION: (*NAVIGATION, topics.NAV_PATH, topics.PROTECTION_LEVEL, *_transforms()),
        RECORDER: (),
    }  # fmt: skip
    return {*own[name], topics.DIAGNOSTICS}


def subscribed(name: str, scenario: Scenario) -> set[Topic]:
    """Return the topics of the graph that a node may listen to."""
    if (one := instruments_of(scenario).get(name)) is not None:
        adapter = adapter_of(one)
        # the raw readings of a real instrument, where it does not simulate one
        return {topics.TRUTH_FIX, adapter.raw, *_beside(adapter), *NAVIGATION}
    reduced = [adapter_of(one).reduced for one in scenario.each_field]
    own: dict[str, Iterable[Topic]] = {
        topics.INS_SIM: (topics.NAV_ODOM, topics.FIX, *reduced, topics.DIAGNOSTICS),
        topics.PMHT_MM: (*reduced, *NAVIGATION),
        topics.UKF_FUSION: (topics.IMU, topics.FIX, topics.INFORMATION, topics.INITIAL_POSE),
        RECORDER: topics_in_use(scenario),
    }
    return set(own[name])


def states_heard(name: str, scenario: Scenario) -> set[str]:
    """Return the names of the topics by which a node hears the states of others."""
    others = set(nodes_of(scenario)) - {name} if name == topics.INS_SIM else set()
    return {f"{other}/transition_event" for other in others}


def _transforms() -> tuple[Topic, ...]:
    return tuple(topic for topic in (topics.TF, topics.TF_STATIC) if topic is not None)


def _beside(adapter: Adapter) -> tuple[Topic, ...]:
    """Return the topics of an instrument beside the one that an adapter reads."""
    return (topics.SCALAR_FIELD,) if adapter.raw is topics.MAGNETIC_FIELD else ()


def services(name: str) -> tuple[str, ...]:
    """Return the services that a node answers."""
    own = ("reset",) if name in RESETTABLE else ()
    return (*PARAMETERS, *LIFECYCLE, *own)


def policy(scenario: Scenario) -> ET.ElementTree:
    """Return the policy of a scenario's graph with a recorder."""
    root = ET.Element("policy", version="0.2.0")
    enclaves = ET.SubElement(root, "enclaves")
    for name in (*nodes_of(scenario), RECORDER):
        enclave = ET.SubElement(enclaves, "enclave", path=f"{ENCLAVES}/{name}")
        profiles = ET.SubElement(enclave, "profiles")
        profile = ET.SubElement(profiles, "profile", ns="/", node=name)
        answered = [f"~/{service}" for service in services(name)]
        _allow(profile, "services", "reply", "service", answered)
        names = sorted(topic.name for topic in subscribed(name, scenario))
        names += sorted(states_heard(name, scenario))
        _allow(profile, "topics", "subscribe", "topic", names)
        names = sorted(topic.name for topic in published(name, scenario))
        _allow(profile, "topics", "publish", "topic", [*COMMON_PUBLISHED, *names])
    tree = ET.ElementTree(root)
    ET.indent(tree)
    return tree


def _allow(profile: ET.Element, kind: str, what: str, item: str, names: Iterable[str]) -> None:
    allowed = ET.SubElement(profile, kind, {what: "ALLOW"})
    for name in names:
        ET.SubElement(allowed, item).text = name


if __name__ == "__main__":
    policy(Scenario()).write(sys.stdout, encoding="unicode", xml_declaration=True)
    print()
