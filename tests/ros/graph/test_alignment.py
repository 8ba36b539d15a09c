"""A graph that aligns: at rest and on the move with satellites it is the library's closed loop,
and what is not aligned promises nothing."""

from collections.abc import Iterable

import numpy as np
import pytest
from sensor_msgs.msg import NavSatStatus

from helpers.node_bench import run_here
from helpers.recordings import assert_closed_loop, assert_replayed, messages_of
from isogal_ros import topics
from isogal_ros.messages.stamps import to_ns
from isogal_ros.nodes.health import figures_of

_TURNS = (
    "route.waypoints=[[-36.5, 147.3, 12], [-36.49, 147.3, 20], [-36.49, 147.315, 12],"
    " [-36.47, 147.315, 20], [-36.47, 147.34, 12]]",
    "route.turn_rate=0.05",
    "route.acceleration=0.5",
)


def said(messages: Iterable, name: str) -> list:
    """The states of a node in /diagnostics."""
    return [item for array in messages for item in array.status if item.name.endswith(name)]


@pytest.mark.parametrize(
    ("changes", "first", "last"),
    [
        (("imu.grade=precision", "route.at_rest=60"), 10, 10),
        (
            ("imu.grade=tactical", "gnss.available=[[0, 200]]", "gnss.velocity_sigma=0.05",
             "fusion.align_to=0.03", *_TURNS),
            5, 60,
        ),
    ],
    ids=["at rest", "satellites"],
)  # fmt: skip
def test_aligned_graph_is_the_library(scenario, tmp_path, changes, first, last) -> None:
    short = scenario("route.duration=150.0", "fusion.start=align", "gravity.field=normal",
                     *changes)  # fmt: skip
    run_here(short, tmp_path / "bag")
    graph, _ = assert_closed_loop(tmp_path / "bag", short, 1e-6)
    assert graph.published.any()
    assert np.hypot(*graph.error[0, -1]) < 200.0
    wanted = topics.NAV_FIX, topics.PROTECTION_LEVEL, topics.DIAGNOSTICS
    found = messages_of(tmp_path / "bag", *wanted)
    none = {
        to_ns(fix.header.stamp) // 10**9
        for fix in found["nav/fix"]
        if fix.status.status == NavSatStatus.STATUS_NO_FIX
    }
    assert first - 1 <= max(none) <= last
    assert none == set(range(max(none) + 1))
    stamps = {to_ns(fix.header.stamp) for fix in found["nav/fix"]}
    assert len(found["nav/protection_level"]) >= len(stamps) - len(none)
    states = said(found["/diagnostics"], "ukf_fusion_node")
    assert any("aligning" in item.message for item in states)
    assert figures_of(states[-1])["aligned"] == "True"
    assert "aligning" not in states[-1].message
    assert_replayed(tmp_path / "bag")
