"""A turn that nobody has measured: whoever is wrong says that it may be."""

import math

import numpy as np
import pytest

from helpers.node_bench import feed_of, played
from isogal_ros import topics
from ukf_fusion_node.watch import UnresolvedGap

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
    player = feed_of(turning).player()
    player.bus.change = lambda topic, data: (
        [] if topic == topics.IMU.name and abs(player.bus.now - 600.0) <= GAP / 2.0 else [data]
    )
    track, silent = played(player)
    assert track.error[track.time > 600.0].max() > 150.0
    assert silent == []
