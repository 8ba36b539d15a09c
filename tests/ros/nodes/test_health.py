"""What a node says about itself."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from isogal_ros.nodes.health import ERROR, OK, WARN, Health, figures_of

S = 10**9


class Listener:
    def __init__(self) -> None:
        self.arrays = []

    def publish(self, array) -> None:
        status = array.status[0]
        self.arrays.append((status.level, status.message, figures_of(status), len(array.status)))


@pytest.fixture
def out() -> Listener:
    return Listener()


@pytest.fixture
def health(out) -> Health:
    return Health("node", out, S, print)


def test_once_a_period(health, out) -> None:
    for ns in range(0, 5 * S, S // 4):
        health.tick(ns)
    assert len(out.arrays) == 5


def test_a_change_is_said_at_once(health, out) -> None:
    health.tick(0)
    health.state(OK, "running")
    health.state(OK, "running")
    health.state(ERROR, "broken")
    assert [(level, message) for level, message, *_ in out.arrays] == [
        (OK, "starting"),
        (OK, "running"),
        (ERROR, "broken"),
    ]


def test_drops_are_counted_and_warned_of_for_a_period(health, out) -> None:
    health.state(OK, "running")
    for i in range(50):
        health.drop("imu", f"stamp {i}.5 s is old")
    assert len(out.arrays) == 2  # the same trouble with other numbers is said once
    health.drop("imu", "not finite")
    assert len(out.arrays) == 3
    assert out.arrays[-1][:2] == (WARN, "running; dropped imu: not finite")
    health.tick(S)
    assert out.arrays[-1][0] == WARN
    assert out.arrays[-1][2]["dropped imu"] == "51"
    health.tick(2 * S)
    assert out.arrays[-1][:2] == (OK, "running")
    assert out.arrays[-1][2]["dropped imu"] == "51"


def test_more_statuses(health, out) -> None:
    health.figures["error"] = 1.25
    health.publish(DiagnosticStatus(name="batch"))
    health.publish()
    assert [count for *_, count in out.arrays] == [2, 1]
    assert out.arrays[0][2] == {"error": "1.25"}


def test_a_period_is_of_wall_time_where_there_is_a_clock(out) -> None:
    """A simulation at 500 times real time does not say it 500 times a second."""
    now = 100.0
    health = Health("node", out, S, print, clock=lambda: now)
    for ns in range(0, 5 * S, S // 4):
        health.tick(ns)
    assert len(out.arrays) == 1
    now += 1.0
    health.tick(5 * S)
    assert len(out.arrays) == 2
