"""Nodes whose messages go past the middleware say the same, to the bit."""

from rclpy.serialization import deserialize_message

from helpers.recordings import collect
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.player import Player
from isogal_ros.graph.recorded import load

KEPT = {
    "truth": topics.TRUTH_FIX,
    "first_nav": topics.NAV_FIX,
    "last_nav": topics.NAV_FIX,
    "readings": topics.DISTURBANCE,
    "fixes": topics.FIX,
}


def test_it_says_what_a_graph_says(recording, scenario) -> None:
    recorded = collect(recording)
    player = Player(load(BagReader(recording), scenario(), changed=True), {}, {})
    with player.bus:
        player.play()
    assert player.bus.errors == []
    for name, topic in KEPT.items():
        here, there = (getattr(one, name) for one in (player.collector, recorded))
        assert here.keys() == there.keys(), name
        for ns in here:  # serialised, the same message may have other padding
            one, other = (deserialize_message(store[ns], topic.type) for store in (here, there))
            assert str(one) == str(other), name
