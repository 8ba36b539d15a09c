"""Nodes are managed nodes, start by themselves unless told not to, and give memory back."""

import ctypes
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node

from helpers.node_bench import PATIENCE, bench, stamps
from isogal.errors import InputError
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
        made.wait(lambda: made.node.ready)
        assert made.node.trigger_deactivate() == SUCCESS
        level, message, figures = made.says()[-1]
        assert (level, figures["ready"]) == (WARN, "False")
        assert "inactive: messages are let go until it is activated" in message
        assert made.node.trigger_activate() == SUCCESS
        assert made.says()[-1][2]["ready"] == "True"
        assert made.node.trigger_shutdown() == SUCCESS
        assert made.node.finished


@pytest.mark.parametrize("transition", [Transition.TRANSITION_ACTIVATE, 77])
def test_a_transition_that_the_state_does_not_have_is_refused(
    domain, scenario, transition
) -> None:
    """By a client, as lifecycle managers are: the executor would raise."""
    values = node_values(scenario(), {}, UkfFusionNode.sections)
    with local_context(domain) as context:
        node, asker = UkfFusionNode("asked", values, context), Node("asker", context=context)
        executor = make_executor(context)
        for one in (node, asker):
            executor.add_node(one)
        client = asker.create_client(ChangeState, "asked/change_state")
        assert client.wait_for_service(PATIENCE)
        answer = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
        executor.spin_until_future_complete(answer, PATIENCE)
        executor.shutdown()
        assert answer.result().success is False
        assert node.active
        for one in (node, asker):
            one.destroy_node()


def test_what_cannot_be_configured_stays_unconfigured(scenario, tmp_path) -> None:
    (tmp_path / "other.txt").touch()
    own = {"bag": str(tmp_path)}
    with bench(RECORDER, scenario(), autostart=False, **own) as made:
        assert made.node.trigger_configure() == FAILURE
        assert not (made.node.configured or made.node.active)
        (tmp_path / "other.txt").unlink()
        assert made.node.trigger_configure() == SUCCESS
    with (
        pytest.raises(InputError, match="there is a bag already"),
        bench(RECORDER, scenario(), **own),
    ):
        pass


def test_a_recorder_finishes_its_bag_when_cleaned_up(scenario, tmp_path) -> None:
    with bench(RECORDER, scenario(), bag=str(tmp_path / "bag")) as made:
        made.imu(1)
        made.wait(made.node.received)
        assert made.node.trigger_deactivate() == SUCCESS
        assert made.node.trigger_cleanup() == SUCCESS
        reader = BagReader(tmp_path / "bag")
        assert [item.topic for item in reader.messages()].count("/imu/data_raw") == 1
        assert reader.cut is None


BLOCKS, SIZE = 2000, 16_000
"""32 MB of blocks that the C library does not take from the system one by one."""


def resident() -> float:
    """MB of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def test_what_lies_below_a_block_in_use_is_given_back() -> None:
    library = ctypes.CDLL(None)
    if not hasattr(library, "malloc_trim"):
        pytest.skip("not glibc")
    library.malloc.restype = ctypes.c_void_p
    blocks = [ctypes.c_void_p(library.malloc(ctypes.c_size_t(SIZE))) for _ in range(BLOCKS)]
    for block in blocks:
        ctypes.memset(block, 1, SIZE)
    for block in blocks[:-1]:
        library.free(block)
    before = resident()
    heartbeat.give_memory_back()
    assert resident() < before - 25.0
    library.free(blocks[-1])


def test_a_node_gives_it_back_when_it_is_time(scenario, monkeypatch) -> None:
    given = []
    monkeypatch.setattr(heartbeat, "give_memory_back", lambda: given.append(True))
    with bench(topics.UKF_FUSION, scenario()) as made:
        made.bus.tick()
        assert not given
        monkeypatch.setattr(heartbeat, "FREE_EVERY", 0.0)
        made.bus.tick()
        assert given


S = 10**9


class Listener:
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
    return Health("node", out, S, print)


def test_once_a_period(health, out) -> None:
    for ns in range(0, 5 * S, S // 4):
        health.tick(ns)
    assert len(out.arrays) == 5


def test_a_change_is_said_at_once(health, out) -> None:
    health.tick(0)
    health.state(OK, "running")
    health.state(OK, "running")
    health.state(ERROR, "broken")
    assert [(level, message) for level, message, *_ in out.arrays] == [
        (OK, "starting"),
        (OK, "running"),
        (ERROR, "broken"),
    ]


def test_drops_are_counted_and_warned_of_for_a_period(health, out) -> None:
    health.state(OK, "running")
    for i in range(50):
        health.drop("imu", f"stamp {i}.5 s is old")
    assert len(out.arrays) == 2  # the same trouble with other numbers is said once
    health.drop("imu", "not finite")
    assert len(out.arrays) == 3
    assert out.arrays[-1][:2] == (WARN, "running; dropped imu: not finite")
    health.tick(S)
    assert out.arrays[-1][0] == WARN
    assert out.arrays[-1][2]["dropped imu"] == "51"
    health.tick(2 * S)
    assert out.arrays[-1][:2] == (OK, "running")
    assert out.arrays[-1][2]["dropped imu"] == "51"


def test_more_statuses(health, out) -> None:
    health.figures["error"] = 1.25
    health.publish(DiagnosticStatus(name="batch"))
    health.publish()
    assert [count for *_, count in out.arrays] == [2, 1]
    assert out.arrays[0][2] == {"error": "1.25"}


def test_a_period_is_of_wall_time_where_there_is_a_clock(out) -> None:
    """A simulation at 500 times real time does not say it 500 times a second."""
    now = 100.0
    health = Health("node", out, S, print, clock=lambda: now)
    for ns in range(0, 5 * S, S // 4):
        health.tick(ns)
    assert len(out.arrays) == 1
    now += 1.0
    health.tick(5 * S)
    assert len(out.arrays) == 2
