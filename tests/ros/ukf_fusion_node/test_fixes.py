"""Which fixes are used: each stamp once, whole if it comes whole, in any order of arrival."""

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.navigators import ROUTE, error_between, fly
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fields.known_gravity import KnownGravity, Residual
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.matching.interfaces import Fix, Information
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.messages.whole_fix import WholeFix, fill_whole_fix, read_whole_fix
from isogal_ros.nodes.health import Health
from isogal_ros.topics import FIX, INFORMATION
from ukf_fusion_node.corrections import Corrections
from ukf_fusion_node.fixes import PATIENCE, FixQueue

WHOLE = WholeFix(Fix(10.0, -0.6, 2.5, np.eye(2)))
POSITION = "a NavSatFix"


class Time:
    """A wall clock that is set by hand."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_stamp_that_nobody_has_set_is_refused() -> None:
    """Within the horizon it would be a fix of the run's beginning."""
    queue = FixQueue(lambda: 1)
    for add, what in ((queue.add_whole, WHOLE), (queue.add_position, POSITION)):
        with pytest.raises(BadMessageError, match="not set"):
            add(0, what)
    assert not queue


@pytest.mark.parametrize("age", [0.0, 31.0, 1100.0])
def test_a_position_waits_from_its_arrival_on_whatever_its_age(age) -> None:
    """As both topics may come late by the same time: 40 s were once enough to part them."""
    clock = Time()
    clock.now = 5000.0
    queue = FixQueue(lambda: 1, clock=clock)
    queue.add_position(10, POSITION)
    assert queue.due(10 + from_seconds(age)) == []
    clock.now += 0.9 * PATIENCE
    assert queue.due(10 + from_seconds(age)) == []
    queue.add_whole(10, WHOLE)
    assert queue.due(10 + from_seconds(age)) == [(10, WHOLE)]


def test_a_position_that_is_all_there_is() -> None:
    clock = Time()
    queue = FixQueue(lambda: 1, clock=clock)
    queue.add_position(10, POSITION)
    clock.now = PATIENCE + 1.0
    assert queue.due(0) == [(10, POSITION)]
    alone = FixQueue(lambda: 0, clock=clock)
    alone.add_position(10, POSITION)
    assert alone.due(0) == [(10, POSITION)]


def test_a_fix_waits_for_the_navigator_but_not_long() -> None:
    queue = FixQueue(lambda: 1, ahead_ns=100)
    queue.add_whole(150, WHOLE)
    queue.add_whole(300, WHOLE)
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
def undisturbed() -> tuple[FilterState, dict[int, list]]:
    """The state at the end, and the messages of each fix."""
    it, messages, corrections = filter_of(), {}, Corrections(Health("x", Silent(), 10**9))
    for _ in range(150):
        stamp = advance(it)
        if stamp in STAMPS:
            whole, position = INFORMATION.type(), FIX.type()
            fill_whole_fix(whole, from_seconds(stamp), sent := fix_at(it, stamp))
            position.header.frame_id = "base_link"
            place = sent.fix.latitude, sent.fix.longitude, 100.0
            fill_fix(position, from_seconds(stamp), *place, np.eye(3))
            messages[stamp] = [whole, position]
            corrections.apply(it, read_whole_fix(whole))
    return it.state, messages


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_delays_orders_and_repetitions_change_nothing(data) -> None:
    """Each message comes when it likes within the horizon, some of them twice."""
    end, sent = undisturbed()
    arrivals: dict[int, list] = {}
    for stamp, messages in sent.items():
        latest = min(150, stamp + round(HORIZON) - 2)
        for which, message in enumerate(messages):
            for _ in range(data.draw(st.integers(1, 2))):
                when = data.draw(st.integers(stamp, latest))
                arrivals.setdefault(when, []).append((which, message))
    it, queue = filter_of(), FixQueue(lambda: 1)
    corrections, repeated = Corrections(Health("x", Silent(), 10**9)), Counter()
    for _ in range(150):
        now = advance(it)
        for which, message in data.draw(st.permutations(arrivals.get(now, []))):
            ns = to_ns(message.header.stamp)
            try:
                if which:
                    queue.add_position(ns, message)
                else:
                    queue.add_whole(ns, read_whole_fix(message))
            except BadMessageError:
                repeated[which] += 1
            for _, content in queue.due(from_seconds(now)):
                corrections.apply(it, content)
    assert not queue
    assert np.abs(error_between(it.state, end)).max() < 1e-6  # m, m/s, rad
    assert sum(repeated.values()) == sum(map(len, arrivals.values())) - 2 * len(STAMPS)
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
