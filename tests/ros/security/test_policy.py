"""The policy allows what the running graph does, and nothing else."""

import os
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ET
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from helpers.node_graph import names_of
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.plan import Plan
from isogal_ros.security.policy import policy, policy_of


def absolute(name: str, node: str) -> str:
    return f"/{node}/{name[2:]}" if name.startswith("~/") else "/" + name.lstrip("/")


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
            names[what] = {absolute(item.text, node) for item in part}
        found[node] = names
    return found


def wanted(names: dict[str, set[str]], node: str) -> tuple[set[str], ...]:
    """What the policy allows; a simulated instrument listens to no readings of a real one."""
    more = {"/gravimeter/data_raw"} if node == topics.GRAVIMETER else set()
    return names["publish"], names["subscribe"] - more, names["reply"]


def test_it_is_the_running_graph(scenario, allowed, tmp_path) -> None:
    plan = Plan(scenario("matcher.name=pmht"), tmp_path / "bag")
    assert set(allowed) == set(plan.names)
    # in a process without the participants of other tests
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        for name in plan.names:
            expected = wanted(allowed[name], name)
            found = pool.submit(names_of, name, plan.values(name), expected).result()
            assert found == expected, name


def test_nobody_but_its_node_publishes_a_topic(allowed) -> None:
    several = {"/diagnostics", "/rosout", "/parameter_events"}
    others: set[str] = set()
    for names in allowed.values():
        assert not names["publish"] & others - several
        others |= names["publish"]
    assert "/initialpose" not in others  # a user's, who needs an enclave
    assert allowed[RECORDER]["publish"] - several == {f"/{RECORDER}/transition_event"}


def test_the_policy_of_a_parameter_file_has_transforms_and_aids(tmp_path) -> None:
    file = tmp_path / "ship.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    velocity: {kind: dvl}\n"
        "    route: {duration: 100.0}\n    gravity: {field: normal}\n"
        "ukf_fusion_node:\n  ros__parameters:\n"
        "    drivers: {velocity/data_raw: {frame: dvl, from_tf: true}}\n"
    )
    heard = {
        profile.get("node"): {
            item.text for part in profile if "subscribe" in part.attrib for item in part
        }
        for profile in policy_of(str(file)).getroot().iter("profile")
    }
    assert {name for name, found in heard.items() if "/tf_static" in found} == {topics.UKF_FUSION}
    assert topics.VELOCITY.name in heard[topics.UKF_FUSION]


WRITING = """
import importlib, os, runpy, sys

for name in sys.argv[1:]:
    importlib.import_module(name)
for name in sys.argv[1:]:
    if os.fork() == 0:
        sys.argv[1:] = []
        del sys.modules[name]
        runpy.run_module(name, run_name="__main__", alter_sys=True)
        break
    print(os.waitstatus_to_exitcode(os.wait()[1]), file=sys.stderr)
else:
    os._exit(0)
"""
"""Each module as a program, in a process that has imported what it needs."""


def test_what_is_generated_may_be_cut_off() -> None:
    names = "security.policy", "graph.parameter_reference", "parameters.bringup_file"
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "wb") as closed_pipe:
        command = [sys.executable, "-c", WRITING, *(f"isogal_ros.{name}" for name in names)]
        done = subprocess.run(
            command,
            stdout=closed_pipe,
            stderr=subprocess.PIPE,
            timeout=120,
            check=False,
            text=True,
        )
    assert (done.returncode, done.stderr.split()) == (0, ["141"] * 3)


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
def test_it_can_be_written(capsys, monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", ["policy"])
    runpy.run_module("isogal_ros.security.policy", run_name="__main__")
    assert ET.fromstring(capsys.readouterr().out).get("version") == "0.2.0"
