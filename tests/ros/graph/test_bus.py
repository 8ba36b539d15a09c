"""Nodes without middleware: the same classes say the same, to the bit."""

import pytest
from rclpy.serialization import deserialize_message

from helpers.recordings import collect
from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.faults.stage import Feed, Stage
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.plan import Plan

KEPT = {
    "truth": topics.TRUTH_FIX,
    "first_nav": topics.NAV_FIX,
    "last_nav": topics.NAV_FIX,
    "readings": topics.DISTURBANCE,
    "fixes": topics.FIX,
}


@pytest.fixture(scope="module")
def feed(scenario) -> Feed:
    return Feed(scenario(), 0)


def test_it_says_what_a_graph_says(feed, recording) -> None:
    stage, recorded = Stage(feed).play(), collect(recording)
    assert stage.bus.errors == []
    for name, topic in KEPT.items():
        here, there = (getattr(one, name) for one in (stage.collector, recorded))
        assert here.keys() == there.keys(), name
        for ns in here:  # serialised, the same message may have other padding
            one, other = (deserialize_message(store[ns], topic.type) for store in (here, there))
            assert str(one) == str(other), name


def test_a_node_that_is_stopped_takes_all_later(feed) -> None:
    stage = Stage(feed)
    stamps = stage.stamps()
    node = stage.nodes[topics.UKF_FUSION]
    for ns in stamps[:100]:
        if ns == stamps[20]:
            stage.bus.stop(node)
        stage.step(ns)
    assert node.samples == 20
    stage.bus.go(node)
    assert node.samples == 100
    assert len(stage.collector.last_nav) == 101  # and the start


def test_a_node_that_is_taken_off_says_nothing(feed) -> None:
    stage = Stage(feed)
    stamps = stage.stamps()
    for ns in stamps[:40]:
        if ns == stamps[20]:
            stage.kill(topics.UKF_FUSION)
        stage.step(ns)
    assert max(stage.collector.last_nav) == stamps[19]
    assert stage.bus.listeners(topics.IMU.name) == 0


def test_bad_parameters_are_refused(scenario) -> None:
    values = Plan(scenario(), None).values(topics.UKF_FUSION)
    with pytest.raises(InputError, match="unknown parameter 'horizn', did you mean 'horizon'"):
        Bus().add(topics.UKF_FUSION, values | {"horizn": 3.0})
