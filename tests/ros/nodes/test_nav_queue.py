"""The navigator's states by stamp, and its jumps."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from helpers.node_bench import nav_messages
from isogal.scenario import load_scenario
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.nodes import nav_queue
from isogal_ros.nodes.nav_queue import NavQueue

S = 10**9
SCENARIO = load_scenario()


class Buffer:
    """A NavQueue whose node is a stand-in."""

    def __init__(self, publishers: int = 1) -> None:
        self.handlers = {}
        extra = SimpleNamespace(get_publisher_count=lambda: publishers)

        def listen(topic, handler, raw):
            assert raw
            self.handlers[topic.name] = handler
            return extra

        self.watches, self.wall_time = {}, 0.0
        node = SimpleNamespace(
            scenario=SCENARIO,
            listen=listen,
            health=SimpleNamespace(tick=lambda ns: None),
            monotonic=lambda: self.wall_time,
            watch=self.watches.__setitem__,
        )
        self.buffer = NavQueue(node, lambda *_: None)

    def feed(self, ns: int, *place: float, covariance: bool = True, **more: Any) -> None:
        for topic, message in nav_messages(SCENARIO, ns, *place, **more)[not covariance :]:
            self.handlers[topic.name](serialize_message(message))


PLACE = (math.radians(-37.9), math.radians(144.6))


@pytest.mark.parametrize("publishers", [0, 1])
def test_it_waits_for_the_covariance_where_it_is_published_until_a_later_one(publishers) -> None:
    buffer = Buffer(publishers)
    buffer.feed(5 * S, *PLACE, covariance=False)
    assert (buffer.buffer.at(5 * S) is None) == (publishers == 1)
    buffer.feed(11 * S, *PLACE)
    covariance = buffer.buffer.at(5 * S).covariance
    assert np.diag(covariance) == pytest.approx([900.0, 900.0, 0.01, 0.01])


def test_a_second_message_of_a_stamp_is_a_jump() -> None:
    buffer = Buffer()
    buffer.feed(5 * S, *PLACE)
    buffer.feed(5 * S, PLACE[0] + 1e-5, PLACE[1], velocity=(10.5, 10.0))
    buffer.feed(5 * S, PLACE[0] + 1e-5, PLACE[1] - 1e-5, velocity=(10.5, 9.0))
    buffer.feed(6 * S, *PLACE)
    (begin, first), (end, second) = buffer.buffer.take_changes(6 * S)
    assert begin == end == 5 * S
    assert first == pytest.approx([63.6, 0.0, 0.5, 0.0, 0, 0, 0], abs=0.1)
    assert second == pytest.approx([0.0, -50.3, 0.0, -1.0, 0, 0, 0], abs=0.1)
    assert buffer.buffer.at(5 * S).velocity[0] == pytest.approx(10.0)  # the state before any fix
    assert not buffer.buffer.changes


def test_old_states_are_dropped() -> None:
    buffer = Buffer()
    for i in range(1100):
        buffer.feed(i * S, *PLACE)
    with pytest.raises(BadMessageError, match="said nothing"):
        buffer.buffer.at(10 * S)
    with pytest.raises(BadMessageError, match="older than all that are kept"):
        buffer.feed(3 * S, *PLACE)
    assert buffer.buffer.at(1000 * S) is not None


def test_a_flood_is_not_kept(monkeypatch) -> None:
    monkeypatch.setattr(nav_queue, "REPEATED", 8)
    buffer = Buffer()
    with pytest.raises(BadMessageError, match=r"more than 8 messages of 5\.000 s"):
        for k in range(20):
            buffer.feed(5 * S, PLACE[0] + 1e-6 * k, PLACE[1])
    for k in range(6, 20):
        buffer.feed(k * S, *PLACE)
        buffer.feed(k * S, PLACE[0] + 1e-6, PLACE[1])
    assert [ns for ns, _ in buffer.buffer.changes] == [k * S for k in range(12, 20)]


def test_a_gap_has_the_states_at_either_side() -> None:
    """One of up to ten seconds, and what comes late, are none."""
    buffer = Buffer()
    for second in (5, 6, 16, 11, 80, 81):
        buffer.feed(second * S, *PLACE, variance=float(second))
    assert list(buffer.buffer.take_changes(79 * S)) == []
    ((before, after),) = buffer.buffer.take_changes(80 * S)
    assert (before.ns, after.ns) == (16 * S, 80 * S)
    assert after.covariance.shape == (7, 7)
    assert list(buffer.buffer.take_changes(90 * S)) == []


def test_a_reading_that_nothing_answers_is_said() -> None:
    """A navigator that is silent, or whose clock is another."""
    buffer = Buffer()
    (unanswered,) = buffer.watches.values()
    buffer.wall_time = 100.0
    buffer.buffer.put(1_700_000_000 * S, None)
    assert unanswered() is None
    buffer.wall_time = 111.0
    assert unanswered() == "1 readings wait for nav/* of 1700000000.000 s, which has not come"
    buffer.feed(5 * S, *PLACE)
    assert "is at 5.000 s" in unanswered()
    buffer.feed(1_700_000_000 * S, *PLACE)
    assert unanswered() is None
