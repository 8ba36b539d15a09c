"""A turn that nobody has measured: whoever is wrong says that it may be."""

import math

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from isogal_ros import topics
from isogal_ros.faults.trials import Feed, track_of
from isogal_ros.nodes.health import OK
from ukf_fusion_node.unresolved_gap import UnresolvedGap

GAP = 60.0
"""s."""


def test_it_lasts_until_fixes_have_agreed_for_a_time() -> None:
    unresolved = UnresolvedGap(100)
    unresolved.renew(5)
    assert unresolved.text(6, False) is None  # there was no gap
    unresolved.begin(10)
    assert unresolved.text(110, False)
    unresolved.renew(60)
    assert unresolved.text(160, False)
    assert unresolved.text(161, True)  # the filter is not sure itself
    assert unresolved.text(161, False) is None
    assert unresolved.text(50, False) is None


def elbow(degrees: float) -> str:
    """Waypoints of ten minutes north-east, and six at an angle to that."""
    place, heading, rows = np.array([-36.6, 146.9]), math.radians(45.0), []
    for seconds, turn in ((0.0, 0.0), (600.0, 0.0), (400.0, math.radians(degrees))):
        heading += turn
        along = np.array([math.cos(heading), math.sin(heading) / math.cos(math.radians(-36.6))])
        place = place + np.degrees(22.0 * seconds / 6.371e6) * along
        rows.append([*place.tolist(), 22.0])
    return f"route.waypoints={rows}"


@pytest.mark.parametrize("degrees", [30.0, 90.0])
def test_a_sharp_turn_in_a_gap_is_never_silent(scenario, degrees) -> None:
    own = "matcher.name=pmht", "matcher.batch_length=30", "matcher.stride=5"
    turning = scenario(elbow(degrees), "route.turn_rate=0.1", "route.duration=960.0", *own)
    player, wrong = Feed(turning, 0).player(), {}
    player.bus.hear(topics.DIAGNOSTICS, lambda data: take(data, wrong))
    player.bus.change = lambda topic, data: (
        [] if topic == topics.IMU.name and abs(player.bus.now - 600.0) <= GAP / 2.0 else [data]
    )
    told = {}
    with player.bus:
        for ns in sorted(player.recorded.sensors[topics.IMU]):
            player.play(ns / 1e9)
            told[ns / 1e9] = any(wrong.values())
    track = track_of(player.collector)
    after = track.time > 600.0
    assert track.error[after].max() > 150.0
    honest = track.error < 3.0 * track.sigma
    silent = [
        t for t, is_honest in zip(track.time, honest, strict=True) if not (is_honest or told[t])
    ]
    assert silent == []


def take(data: bytes, wrong: dict[str, bool]) -> None:
    """Note which nodes say that something is wrong."""
    for item in deserialize_message(data, topics.DIAGNOSTICS.type).status:
        wrong[item.name] = item.level != OK
