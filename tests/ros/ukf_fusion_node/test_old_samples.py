"""Time never turns back: neither by old samples, nor where samples are found untrue."""

from collections.abc import Iterator

import numpy as np
import pytest

from helpers.node_bench import Bench, bench
from isogal_ros import topics
from isogal_ros.messages.stamps import to_ns, to_seconds

LEVEL = np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0])
NOISE = LEVEL + np.random.default_rng(5).normal(0.0, 1e-4, (200, 6))
OUTPUTS = (topics.NAV_ODOM, topics.NAV_FIX, topics.NAV_PATH)


def send(made: Bench, seconds: float, values) -> None:
    """Publish a sample, (6,)."""
    made.imu(seconds, values[:3], values[3:])


def no_fix(made: Bench, seconds: float) -> None:
    """Publish that a batch gave no fix."""
    made.fix(seconds, 0.0, 0.0, status=-1)


def odometry(made: Bench) -> list[float]:
    """Stamps of nav/odom, s."""
    return [to_seconds(to_ns(one.header.stamp)) for one in made.heard["nav/odom"]]


def assert_in_order(made: Bench) -> None:
    for topic in OUTPUTS:
        times = [to_ns(one.header.stamp) for one in made.heard[topic.name]]
        assert times == sorted(times), topic.name


def place(made: Bench) -> np.ndarray:
    """Where the newest odometry is, m."""
    point = made.heard["nav/odom"][-1].pose.pose.position
    return np.array([point.x, point.y, point.z])


@pytest.fixture
def played(scenario) -> Iterator[Bench]:
    """A filter after a hundred samples."""
    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in range(1, 101):
            send(made, k, NOISE[k])
        assert odometry(made)[-1] == 100.0
        yield made


@pytest.fixture(scope="module")
def undisturbed(scenario) -> np.ndarray:
    """Where a filter is that had no other samples."""
    with bench(topics.UKF_FUSION, scenario()) as alone:
        for k in range(1, 111):
            send(alone, k, NOISE[k])
        return place(alone)


@pytest.mark.parametrize("differ", [0.0, 0.5], ids=["the same", "two by turns"])
def test_old_samples_change_nothing(played, undisturbed, differ) -> None:
    """A block of equal ones was once taken for a stuck sensor, and the newest true samples were
    forgotten with it; so was one for each that differs from its neighbours."""
    other = NOISE[0] + [differ, 0, 0, 0, 0, 0]
    for k in range(300):
        send(played, 95.0 + 1e-3 * k, (NOISE[0], other)[k % 2])
        if k == 150:
            no_fix(played, 90.0)
    for k in range(101, 111):
        send(played, k - 5.0, other)
        send(played, k, NOISE[k])
    assert_in_order(played)
    assert odometry(played)[-12:] == [100.0, 100.0, *range(101, 111)]
    assert place(played) == pytest.approx(undisturbed, abs=0)
    assert played.node.health.dropped == {"imu/data_raw": 310}


def test_what_was_published_of_untrue_samples_is_not_published_again(played) -> None:
    """A sensor that is stuck is found out late: the samples since are forgotten. A fix that comes
    then is answered at the stamp that was reached, with what the state has become by then."""
    for k in range(101, 107):
        send(played, k, NOISE[100])
    assert played.node.health.dropped["imu/data_raw"] == 2
    reached = odometry(played)[-1]
    assert 101.0 < reached < 110.0
    no_fix(played, reached - 20.0)
    assert odometry(played)[-2:] == [reached, reached]
    moved = place(played)
    send(played, reached, NOISE[106])  # too old, if later than the newest true one
    assert "not later" in played.node.health.why["imu/data_raw"]
    send(played, 107.0, NOISE[107])
    assert_in_order(played)
    twist = played.heard["nav/odom"][-1].twist.twist.linear
    speed = np.linalg.norm(place(played) - moved) / (107.0 - reached)
    assert speed == pytest.approx(np.linalg.norm([twist.x, twist.y]), abs=0.2)
