"""Nodes are managed nodes, start by themselves unless told not to, and give memory back."""

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node

from helpers.node_bench import PATIENCE, bench, stamps
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.domain import local_context
from isogal_ros.nodes import heartbeat
from isogal_ros.nodes.base import FAILURE, SUCCESS
from isogal_ros.nodes.health import ERROR, OK, WARN, Health, figures_of
from isogal_ros.nodes.spin import make_executor
from isogal_ros.parameters.values import node_values
from ukf_fusion_node.node import UkfFusionNode


def test_every_transition(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario(), autostart=False) as made:
        assert not (made.node.configured or made.node.active)
        assert "imu/data_raw" not in made.node.listening
        assert made.node.trigger_configure() == SUCCESS
        made.imu(1)
        assert made.node.samples == 0  # let go
        assert made.node.trigger_activate() == SUCCESS
        for k in (1, 2, 3):
            made.imu(k)
        assert made.node.trigger_deactivate() == SUCCESS
        made.imu(4)
        assert 4 not in stamps(made, topics.NAV_FIX)
        assert made.node.trigger_cleanup() == SUCCESS
        made.heard["/diagnostics"].clear()
        made.wait(made.says, "its heartbeat")
        made.heard["nav/fix"].clear()
        assert made.node.trigger_configure() == SUCCESS
        assert made.node.trigger_activate() == SUCCESS
        made.imu(1)
        made.wait(lambda: stamps(made, topics.NAV_FIX) == [0, 1])  # begun anew
        assert made.node.samples == 1  # what listened before is gone
        made.wait(lambda: made.node.ready)
        assert made.node.trigger_deactivate() == SUCCESS
        level, message, figures = made.says()[-1]
        assert (level, figures["ready"]) == (WARN, "False")
        assert "inactive: messages are let go until it is activated" in message
        assert made.node.trigger_activate() == SUCCESS
        assert made.says()[-1][2]["ready"] == "True"
        assert made.node.trigger_shutdown() == SUCCESS
        assert made.node.finished


def test_errors_are_logged_with_and_without_a_pause_between_them(scenario) -> None:
    """rclpy takes one set of options for each line of code, and raises on another."""
    with bench(topics.UKF_FUSION, scenario(), autostart=False) as made:
        made.node.log(ERROR, "of a message", throttle_duration_sec=10.0)
        made.node.log(ERROR, "of the node")


def test_a_transition_that_the_state_does_not_have_is_refused(domain, scenario) -> None:
    """By a client, as lifecycle managers are: the executor would raise."""
    already, none = Transition.TRANSITION_ACTIVATE, 77
    values = node_values(scenario(), {}, UkfFusionNode.sections)
    with local_context(domain) as context:
        node, asker = UkfFusionNode("asked", values, context), Node("asker", context=context)
        executor = make_executor(context)
        for one in (node, asker):
            executor.add_node(one)
        client = asker.create_client(ChangeState, "asked/change_state")
        assert client.wait_for_service(PATIENCE)
        for transition in (already, none):
            answer = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
            executor.spin_until_future_complete(answer, PATIENCE)
            assert answer.result().success is False
        executor.shutdown()
        assert node.active
        for one in (node, asker):
            one.destroy_node()


def test_a_recorder_that_cannot_be_configured_and_one_that_is_cleaned_up(
    scenario, tmp_path
) -> None:
    """One stays unconfigured, the other finishes its bag."""
    (tmp_path / "other.txt").touch()
    with bench(RECORDER, scenario(), autostart=False, bag=str(tmp_path)) as made:
        assert made.node.trigger_configure() == FAILURE
        assert not (made.node.configured or made.node.active)
        (tmp_path / "other.txt").unlink()
        assert made.node.trigger_configure() == SUCCESS
        assert made.node.trigger_activate() == SUCCESS
        made.imu(1)
        made.wait(made.node.received)
        assert made.node.trigger_deactivate() == SUCCESS
        assert made.node.trigger_cleanup() == SUCCESS
    reader = BagReader(tmp_path)
    assert [item.topic for item in reader.messages()].count("/imu/data_raw") == 1
    assert reader.cut is None


def test_a_node_gives_memory_back_when_it_is_time(scenario, monkeypatch) -> None:
    """By what the C library has for it."""
    given = []
    library = SimpleNamespace(malloc_trim=lambda kept: given.append(kept.value))
    monkeypatch.setattr(heartbeat.ctypes, "CDLL", lambda name: library)
    with bench(topics.UKF_FUSION, scenario()) as made:
        made.bus.tick()
        assert not given
        monkeypatch.setattr(heartbeat, "FREE_EVERY", 0.0)
        made.bus.tick()
        assert given == [0]


class Listener:
    """Keeps level, message, figures and number of statuses of each array."""

    def __init__(self) -> None:
        self.arrays = []

    def publish(self, array) -> None:
        status = array.status[0]
        self.arrays.append((status.level, status.message, figures_of(status), len(array.status)))


@pytest.fixture
def out() -> Listener:
    return Listener()


@pytest.fixture
def health(out) -> Health:
    return Health("node", out, print)


def test_a_change_is_said_at_once(health, out) -> None:
    health.renew()
    health.figures["error"] = 1.25
    for level, message in ((OK, "running"), (OK, "running"), (ERROR, "broken")):
        health.state(level, message)
    health.publish(DiagnosticStatus(name="batch"))
    said = [(OK, "starting"), (OK, "running"), (ERROR, "broken"), (ERROR, "broken")]
    assert [(level, message) for level, message, *_ in out.arrays] == said
    assert [count for *_, count in out.arrays] == [1, 1, 1, 2]
    assert out.arrays[-1][2] == {"error": "1.25"}


def test_drops_are_counted_and_warned_of_for_a_period(health, out) -> None:
    health.state(OK, "running")
    for i in range(50):
        health.drop("imu", f"stamp {i}.5 s is old")
    assert len(out.arrays) == 2  # the same trouble with other numbers is said once
    health.drop("imu", "not finite")
    assert len(out.arrays) == 3
    assert out.arrays[-1][:2] == (WARN, "running; dropped imu: not finite")
    health.renew()
    assert out.arrays[-1][0] == WARN
    health.renew()
    assert out.arrays[-1][:2] == (OK, "running")
    assert out.arrays[-1][2]["dropped imu"] == "51"
