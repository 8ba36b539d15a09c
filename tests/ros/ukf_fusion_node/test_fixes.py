"""Which fixes are used: each stamp once, whole if it comes whole, in any order of arrival."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.navigators import fly
from helpers.node_bench import bench
from isogal.fields.known_gravity import KnownGravity, Residual
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.matching.interfaces import Fix
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.whole_fix import WholeFix
from isogal_ros.nodes.health import Health
from isogal_ros.topics import INFORMATION, UKF_FUSION
from ukf_fusion_node.fixes import Corrections, FixQueue

WHOLE = WholeFix(Fix(10.0, -0.6, 2.5, np.eye(2)))


def test_a_stamp_that_nobody_has_set_is_refused() -> None:
    """Within the horizon it would be a fix of the run's beginning."""
    queue = FixQueue()
    with pytest.raises(BadMessageError, match="not set"):
        queue.add(0, WHOLE)
    assert not queue


def test_a_position_is_used_where_nobody_publishes_the_whole(scenario) -> None:
    with bench(UKF_FUSION, scenario()) as made:
        for k in range(1, 6):
            made.imu(k)
        nav = made.heard["nav/fix"][-1]
        place = np.radians([nav.latitude, nav.longitude])
        made.fix(3.0, *place)
        assert made.node.health.figures["fixes accepted"] == 1
        made.publisher(INFORMATION)
        made.fix(4.0, *place)
        assert made.node.health.figures["fixes accepted"] == 1


def test_a_fix_waits_for_the_navigator_but_not_long() -> None:
    queue = FixQueue(100)
    queue.add(150, WHOLE)
    queue.add(300, WHOLE)
    assert queue.due(100) == [(300, WHOLE)]  # to be refused
    assert queue.due(150) == [(150, WHOLE)]


@given(st.permutations([30, 10, 20] * 2), st.integers(0, 40))
def test_in_any_order_each_stamp_is_used_once(arrivals, now) -> None:
    queue, used, repeated = FixQueue(100), [], 0
    for stamp in arrivals:
        try:
            queue.add(stamp, WHOLE)
        except BadMessageError:
            repeated += 1
        used += queue.due(now)
    used += queue.due(40)
    assert not queue
    assert sorted(ns for ns, _ in used) == [10, 20, 30]
    assert repeated == 3


class Silent:
    """Where diagnostics go."""

    def publish(self, _message) -> None:
        """Take it."""


def test_the_map_error_of_a_batch_without_a_fix_counts_and_waits_for_no_navigator() -> None:
    health = Health("x", Silent(), 10**9)
    flight, corrections = fly(), Corrections(health)
    it = InertialNavigator(flight.model, flight.start)
    it.model = replace(it.model, gravity=KnownGravity(residual=Residual(0.0, 1.0)))
    for k in range(20):
        it.imu(k + 1.0, *flight.samples(k, k + 1))
    none = Fix(15.0, 0.0, 0.0, np.full((2, 2), np.nan), "nothing new", map_error=(8e-5, 3e3))
    corrections.apply(None, WholeFix(none))
    corrections.apply(it, WholeFix(none))
    sigma, length = it.state.residual_gravity
    assert (sigma, length) == pytest.approx((np.hypot(8e-5 / np.sqrt(2.0), 1e-6), 3e3))
    assert "fixes accepted" not in health.figures
