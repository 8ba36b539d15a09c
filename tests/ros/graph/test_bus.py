"""Nodes whose messages go past the middleware say the same, to the bit."""

from rclpy.serialization import deserialize_message

from helpers.node_bench import run_here
from helpers.recordings import collect
from isogal_ros import topics

KEPT = {
    "truth": topics.TRUTH_FIX,
    "first_nav": topics.NAV_FIX,
    "last_nav": topics.NAV_FIX,
    "readings": topics.DISTURBANCE,
    "fixes": topics.FIX,
}


def test_it_says_what_a_graph_says(recording, scenario, tmp_path) -> None:
    run_here(scenario(), tmp_path / "bag")
    without, recorded = collect(tmp_path / "bag"), collect(recording)
    for name, topic in KEPT.items():
        here, there = (getattr(one, name) for one in (without, recorded))
        assert here.keys() == there.keys(), name
        for ns in here:  # serialised, the same message may have other padding
            one, other = (deserialize_message(store[ns], topic.type) for store in (here, there))
            assert str(one) == str(other), name
