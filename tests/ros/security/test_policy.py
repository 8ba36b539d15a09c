"""The policy allows what the running graph does, and nothing else."""

import runpy
import sys
import xml.etree.ElementTree as ET
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from helpers.node_graph import names_of
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.plan import Plan
from isogal_ros.security.policy import policy


@pytest.fixture(scope="module")
def allowed(scenario):
    """By node: what it may publish, subscribe to, and answer."""
    found = {}
    for profile in policy(scenario()).getroot().iter("profile"):
        node = profile.get("node")
        names: dict[str, set[str]] = {"publish": set(), "subscribe": set(), "reply": set()}
        for part in profile:
            (what,) = part.attrib
            assert part.get(what) == "ALLOW"
            names[what] = {item.text.replace("~", f"/{node}") for item in part}
        found[node] = names
    return found


def test_it_is_the_running_graph(scenario, allowed, tmp_path) -> None:
    plan = Plan(scenario("matcher.name=pmht"), tmp_path / "bag")
    assert set(allowed) == set(plan.names)
    # in a process without the participants of other tests
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        for name in plan.names:
            expected = [allowed[name][what] for what in ("publish", "subscribe", "reply")]
            if name == topics.GRAVIMETER:  # a simulated one listens to no readings of a real one
                assert "/gravimeter/data_raw" in expected[1]
                expected[1] = expected[1] - {"/gravimeter/data_raw"}
            found = pool.submit(names_of, name, plan.values(name), tuple(expected)).result()
            assert list(found) == expected, name


def test_nobody_but_its_node_publishes_a_topic(allowed) -> None:
    several = {"/diagnostics", "/rosout", "/parameter_events"}
    others: set[str] = set()
    for names in allowed.values():
        assert not names["publish"] & others - several
        others |= names["publish"]
    assert "/initialpose" not in others  # a user's, who needs an enclave
    assert allowed[RECORDER]["publish"] - several == {f"/{RECORDER}/transition_event"}


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
def test_the_policy_of_a_parameter_file_has_transforms_and_aids(
    tmp_path, capsys, monkeypatch
) -> None:
    file = tmp_path / "ship.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    velocity: {kind: dvl}\n"
        "    route: {duration: 100.0}\n    gravity: {field: normal}\n"
        "ukf_fusion_node:\n  ros__parameters:\n"
        "    drivers: {velocity/data_raw: {frame: dvl, from_tf: true}}\n"
    )
    monkeypatch.setattr(sys, "argv", ["policy", str(file)])
    runpy.run_module("isogal_ros.security.policy", run_name="__main__")
    root = ET.fromstring(capsys.readouterr().out)
    assert root.get("version") == "0.2.0"
    heard = {
        profile.get("node"): {
            item.text for part in profile if "subscribe" in part.attrib for item in part
        }
        for profile in root.iter("profile")
    }
    assert {name for name, found in heard.items() if "/tf_static" in found} == {topics.UKF_FUSION}
    assert f"/{topics.VELOCITY.name}" in heard[topics.UKF_FUSION]
