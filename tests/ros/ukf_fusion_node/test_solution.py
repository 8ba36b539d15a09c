"""The filter by the solution of an INS: messages there and back, its error, solutions that are
missing, jump, or are of other frames."""

import math

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from helpers.node_bench import Bench, bench, stamps
from isogal.earth.frames import horizontal_difference
from isogal.inertial.rotations import from_angles
from isogal.sensors.imu import simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.ins_solution import said, unaided_solution
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.aids import fill_twist
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import BASE, MAP, NED_ENU, map_frame
from isogal_ros.messages.ins_solution import fill_error, read_solution
from isogal_ros.messages.odometry import fill_odom
from isogal_ros.messages.position import fill_fix, read_position
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.health import ERROR

SOLUTION = "ins.source=solution"


@pytest.fixture(scope="module")
def rows(scenario):
    """What an unaided INS says, (K + 1, 10)."""
    truth = scenario(SOLUTION).true
    trajectory = build_trajectory(scenario())
    start = draw_initial_state(truth.initial_error, trajectory, truth.seed, [0])
    imu = simulate_imu(truth, trajectory, [0])
    solution = unaided_solution(start, trajectory, imu, truth.samples_per_step > 1)
    return said(truth.ins, solution)[0]


@pytest.fixture
def solving(scenario):
    """A filter of an INS."""
    with bench(topics.UKF_FUSION, scenario(SOLUTION)) as made:
        yield made


def say(made: Bench, seconds: float, row: np.ndarray) -> None:
    """Publish a solution as an Odometry."""
    message = topics.INS_SOLUTION.type(child_frame_id=BASE)
    message.header.frame_id = MAP
    fill_odom(message, from_seconds(seconds), map_frame(made.scenario), row, np.zeros(3))
    made.publish(topics.INS_SOLUTION, message)


def away(made: Bench, row: np.ndarray) -> float:
    """Return how far (m) the state last published is from a solution."""
    latitude, longitude, _ = read_position(made.heard["nav/fix"][-1])
    return float(np.hypot(*horizontal_difference(latitude, longitude, *row[:2])))


def test_a_solution_there_and_back(scenario) -> None:
    frame = map_frame(scenario())
    attitude = from_angles(0.1, -0.05, 4.0)
    row = np.array([-0.61, 2.62, 300.0, 20.0, -5.0, 0.5, *attitude])  # 600 km from the origin
    message = topics.INS_SOLUTION.type(child_frame_id=BASE)
    message.header.frame_id = MAP
    fill_odom(message, 7, frame, row, np.zeros(3))
    found = read_solution(serialize_message(message), frame)
    found[6:] *= np.sign(found[6:] @ row[6:])
    assert found == pytest.approx(row, abs=1e-8)
    message.pose.pose.position.x = math.nan
    with pytest.raises(BadMessageError, match="position is not finite"):
        read_solution(serialize_message(message), frame)


def test_what_is_wrong_is_the_solution_less_the_state() -> None:
    state = np.array([-0.6, 2.5, 100.0, 20.0, 5.0, 0.0, *from_angles(0.0, 0.0, 1.0)])
    solution = state + np.array([1e-6, -2e-6, 3.0, 0.1, -0.2, 0.3, 0.0, 0.0, 0.0, 0.0])
    solution[6:] = from_angles(0.0, 0.0, 1.01)
    message = topics.INS_ERROR.type()
    fill_error(message, 7, solution, state, np.diag(np.arange(1.0, 16.0)))
    point, linear = message.pose.pose.position, message.twist.twist.linear
    assert (point.x, point.y, point.z) == pytest.approx((-10.54, 6.356, 3.0), rel=2e-3)
    assert (linear.x, linear.y, linear.z) == pytest.approx((-0.2, 0.1, -0.3))
    # clockwise from above is about down
    assert message.pose.pose.orientation.z == pytest.approx(-0.005, rel=1e-4)
    assert np.diag(message.pose.covariance.reshape(6, 6)).tolist() == [2, 1, 3, 8, 7, 9]
    assert np.diag(message.twist.covariance.reshape(6, 6)).tolist() == [5, 4, 6, 0, 0, 0]


def test_it_starts_where_the_ins_is_and_follows_no_jump(solving, rows) -> None:
    """A gap costs nothing: after a leap of the stamps the second is believed, and the way there is
    filled in."""
    moved = rows.copy()
    moved[120:, 0] += 500.0 / 6.36e6
    for k in (*range(40, 61), *range(90, 140)):
        say(solving, k, moved[k])
    published = stamps(solving, topics.NAV_FIX)
    assert published[:21] == list(range(40, 61))
    assert published[21:25] == [67, 75, 83, 91]
    assert 120 not in published
    assert away(solving, rows[139]) < 1.0
    assert away(solving, moved[139]) == pytest.approx(500.0, rel=0.01)
    solving.told("position has jumped by")
    error = solving.heard["ins/error"][-1]
    assert error.pose.pose.position.y == pytest.approx(500.0, rel=0.01)
    assert (error.header.frame_id, error.child_frame_id) == ("enu", "enu")
    assert stamps(solving, topics.INS_ERROR)[:22] == [*range(40, 61), 91]


def test_position_and_velocity_are_enough(scenario, rows) -> None:
    bare = scenario(SOLUTION, "ins.attitude=false")
    with bench(topics.UKF_FUSION, bare) as made:
        for k in range(30):
            fix, twist = topics.INS_SOLUTION_FIX.type(), topics.INS_SOLUTION_VELOCITY.type()
            fix.header.frame_id = twist.header.frame_id = BASE
            fill_fix(fix, from_seconds(k), *rows[k, :3].tolist())
            fill_twist(twist, from_seconds(k), NED_ENU @ rows[k, 3:6])
            each = [(topics.INS_SOLUTION_FIX, fix), (topics.INS_SOLUTION_VELOCITY, twist)]
            for topic, message in each[:: (-1) ** k]:  # in either order
                made.publish(topic, message)
        assert stamps(made, topics.NAV_FIX) == list(range(30))
        assert away(made, rows[29]) < 0.01


def test_an_ins_that_has_stopped_is_told(solving, rows) -> None:
    for k in range(10):
        say(solving, k, rows[min(k, 5)])
    solving.told("is the one before once more")
    assert stamps(solving, topics.NAV_FIX) == list(range(6))
    assert not [text for level, text, _ in solving.says() if level == ERROR]
