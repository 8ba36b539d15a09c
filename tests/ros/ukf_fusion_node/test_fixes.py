"""Which fixes are used: each stamp once, whole if it comes whole, in any order of arrival."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import PointCloud2

from helpers.navigators import ROUTE, error_between, fly
from helpers.node_bench import bench
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fields.known_gravity import KnownGravity, Residual
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.matching.interfaces import Fix, Information
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.messages.whole_fix import WholeFix, fill_whole_fix, read_whole_fix
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


# --- the same fixes, delayed, in another order, twice


FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 150.0}))
STAMPS = (20, 50, 51, 90, 120)
HORIZON = 100.0


class Silent:
    """Where diagnostics go."""

    def publish(self, _message) -> None:
        """Take it."""


def filter_of() -> InertialNavigator:
    return InertialNavigator(FLIGHT.model, FLIGHT.start, horizon=HORIZON)


def advance(it: InertialNavigator) -> int:
    k = round(it.time)
    it.imu(k + 1.0, *FLIGHT.samples(k, k + 1))
    return k + 1


def fix_at(it: InertialNavigator, stamp: int) -> WholeFix:
    """What a matcher says of a stamp: information, or with an even stamp also a position only."""
    estimate = Estimate(*(part.copy() for part in it.state.estimate))
    truth = FLIGHT.fix(stamp, 20.0, -30.0)
    covariance = np.array([[40.0**2, 300.0], [300.0, 25.0**2]])
    if stamp == 50:
        return WholeFix(Fix(float(stamp), *truth, covariance))
    error = np.zeros(4)
    metres = metres_per_radian(estimate.position[0], estimate.position[2])
    error[:2] = (estimate.position[:2] - truth) * metres
    matrix = np.zeros((4, 4))
    matrix[:2, :2], matrix[2:, 2:] = np.linalg.inv(covariance), np.eye(2) / 0.1**2
    fix = Fix(float(stamp), *truth, covariance, information=Information(matrix @ error, matrix))
    return WholeFix(fix, estimate)


@cache
def undisturbed() -> tuple[FilterState, dict[int, PointCloud2]]:
    """The state at the end, and the message of each fix."""
    it, messages, corrections = filter_of(), {}, Corrections(Health("x", Silent(), 10**9))
    for _ in range(150):
        stamp = advance(it)
        if stamp in STAMPS:
            messages[stamp] = INFORMATION.type()
            fill_whole_fix(messages[stamp], from_seconds(stamp), fix_at(it, stamp))
            corrections.apply(it, read_whole_fix(messages[stamp]))
    return it.state, messages


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_delays_orders_and_repetitions_change_nothing(data) -> None:
    """Each message comes when it likes within the horizon, some of them twice."""
    end, sent = undisturbed()
    arrivals: dict[int, list[PointCloud2]] = {}
    for stamp, message in sent.items():
        latest = min(150, stamp + round(HORIZON) - 2)
        for _ in range(data.draw(st.integers(1, 2))):
            arrivals.setdefault(data.draw(st.integers(stamp, latest)), []).append(message)
    it, queue, repeated = filter_of(), FixQueue(), 0
    corrections = Corrections(Health("x", Silent(), 10**9))
    for _ in range(150):
        now = advance(it)
        for message in data.draw(st.permutations(arrivals.get(now, []))):
            try:
                queue.add(to_ns(message.header.stamp), read_whole_fix(message))
            except BadMessageError:
                repeated += 1
            for _, whole in queue.due(from_seconds(now)):
                corrections.apply(it, whole)
    assert not queue
    assert np.abs(error_between(it.state, end)).max() < 1e-6  # m, m/s, rad
    assert repeated == sum(map(len, arrivals.values())) - len(STAMPS)
    scale = np.sqrt(np.diag(end.covariance))
    unlike = (it.state.covariance - end.covariance) / scale / scale[:, None]
    assert np.abs(unlike).max() < 1e-6


def test_the_map_error_of_a_batch_without_a_fix_counts_and_waits_for_no_navigator() -> None:
    health = Health("x", Silent(), 10**9)
    corrections, it = Corrections(health), filter_of()
    known = KnownGravity(residual=Residual(0.0, 1.0))
    it.model = replace(it.model, gravity=known)
    for _ in range(20):
        advance(it)
    none = Fix(15.0, 0.0, 0.0, np.full((2, 2), np.nan), "nothing new", map_error=(8e-5, 3e3))
    corrections.apply(None, WholeFix(none))
    corrections.apply(it, WholeFix(none))
    sigma, length = it.state.residual_gravity
    assert (sigma, length) == pytest.approx((np.hypot(8e-5 / np.sqrt(2.0), 1e-6), 3e3))
    assert "fixes accepted" not in health.figures
