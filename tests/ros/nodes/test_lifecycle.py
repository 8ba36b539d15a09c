"""Nodes are managed nodes, and start by themselves unless told not to."""

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from helpers.node_bench import Bench, bench, stamps
from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.nodes.health import WARN


def change(made: Bench, which: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=which))
    return made.call(ChangeState, "change_state", request).success


def state(made: Bench) -> int:
    return made.call(GetState, "get_state", GetState.Request()).current_state.id


def test_a_node_is_active_once_it_is_made(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario()) as made:
        assert state(made) == State.PRIMARY_STATE_ACTIVE


def test_every_transition(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario(), autostart=False) as made:
        assert state(made) == State.PRIMARY_STATE_UNCONFIGURED
        assert "imu/data_raw" not in {item.topic_name[1:] for item in made.node.subscriptions}
        assert change(made, Transition.TRANSITION_CONFIGURE)
        made.imu(1)
        made.settle()
        assert made.node.samples == 0  # let go
        assert change(made, Transition.TRANSITION_ACTIVATE)
        for k in (1, 2, 3):
            made.imu(k)
        made.wait(lambda: 3 in stamps(made, topics.NAV_FIX))
        assert change(made, Transition.TRANSITION_DEACTIVATE)
        made.imu(4)
        made.settle()
        assert 4 not in stamps(made, topics.NAV_FIX)
        assert change(made, Transition.TRANSITION_CLEANUP)
        made.heard["nav/fix"].clear()
        assert change(made, Transition.TRANSITION_CONFIGURE)
        assert change(made, Transition.TRANSITION_ACTIVATE)
        made.publishers.clear()  # the node listens by a new subscription
        made.imu(1)
        made.wait(lambda: stamps(made, topics.NAV_FIX) == [0, 1])  # begun anew
        made.wait(lambda: made.node.ready)
        assert change(made, Transition.TRANSITION_DEACTIVATE)
        made.settle()
        level, message, figures = made.says()[-1]
        assert (level, figures["ready"]) == (WARN, "False")
        assert "inactive: messages are let go until it is activated" in message
        assert change(made, Transition.TRANSITION_ACTIVATE)
        made.settle()
        assert made.says()[-1][2]["ready"] == "True"
        assert change(made, Transition.TRANSITION_ACTIVE_SHUTDOWN)
        assert made.node.finished


def test_what_cannot_be_configured_stays_unconfigured(scenario, tmp_path) -> None:
    (tmp_path / "other.txt").touch()
    own = {"bag": str(tmp_path)}
    with bench(RECORDER, scenario(), autostart=False, **own) as made:
        assert not change(made, Transition.TRANSITION_CONFIGURE)
        assert state(made) == State.PRIMARY_STATE_UNCONFIGURED
        (tmp_path / "other.txt").unlink()
        assert change(made, Transition.TRANSITION_CONFIGURE)
    with (
        pytest.raises(InputError, match="there is a bag already"),
        bench(RECORDER, scenario(), **own),
    ):
        pass


def test_a_recorder_finishes_its_bag_when_cleaned_up(scenario, tmp_path) -> None:
    with bench(RECORDER, scenario(), bag=str(tmp_path / "bag")) as made:
        made.imu(1)
        made.wait(made.node.received)
        assert change(made, Transition.TRANSITION_DEACTIVATE)
        assert change(made, Transition.TRANSITION_CLEANUP)
        reader = BagReader(tmp_path / "bag")
        assert [item.topic for item in reader.messages()].count("/imu/data_raw") == 1
        assert reader.cut is None


def test_a_node_that_was_cleaned_up_goes_on_saying_how_it_is(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario()) as made:
        assert change(made, Transition.TRANSITION_DEACTIVATE)
        assert change(made, Transition.TRANSITION_CLEANUP)
        made.settle()
        made.heard["/diagnostics"].clear()
        made.wait(made.says, "its heartbeat")
