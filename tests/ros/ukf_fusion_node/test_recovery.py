"""Where the filter begins: the scenario's start, a checkpoint, a user's pose, or nowhere."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from std_srvs.srv import Trigger

from helpers.changed_messages import changed
from helpers.node_bench import Bench, bench, stamps
from isogal.earth.frames import horizontal_difference
from isogal.inertial.rotations import matrix, to_angles
from isogal.sensors.imu import simulate_imu
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.frames import MAP, map_frame
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.stamps import from_seconds, set_stamp
from isogal_ros.nodes.health import ERROR, OK, WARN


@pytest.fixture(scope="module")
def drive(scenario):
    trajectory = build_trajectory(scenario())
    imu = simulate_imu(scenario(), trajectory, [0])

    def go(made: Bench, *spans: tuple[int, int]) -> None:
        for first, last in spans:
            for k in range(first, last + 1):
                made.imu(k, tuple(imu.specific_force[0, k - 1]), tuple(imu.angular_rate[0, k - 1]))

    def error(made: Bench, k: int) -> float:
        """Distance (m) from the truth of the state last published, of stamp k."""
        made.wait(lambda: k in stamps(made, topics.NAV_FIX), f"nav/fix of {k} s")
        latitude, longitude, _ = read_position(made.heard["nav/fix"][-1])
        truth = trajectory.latitude[k], trajectory.longitude[k]
        return float(np.hypot(*horizontal_difference(latitude, longitude, *truth)))

    go.error = error
    return go


def sigma(made: Bench) -> float:
    """1-sigma (m) of the state last published."""
    covariance = read_covariance(made.heard["nav/fix"][-1])
    return math.sqrt(covariance[0, 0] + covariance[1, 1])


@pytest.fixture(scope="module")
def ended(scenario, drive, tmp_path_factory) -> tuple[Path, float, float]:
    """Folder of the checkpoints of a filter that ended at 60 s, its error and 1-sigma, m."""
    folder = tmp_path_factory.mktemp("checkpoint")
    with bench(topics.UKF_FUSION, scenario(), checkpoint=str(folder)) as made:
        drive(made, (1, 60))
        return folder, drive.error(made, 60), sigma(made)


@pytest.fixture
def left(ended, tmp_path) -> Path:
    """A copy of that folder."""
    return shutil.copytree(ended[0], tmp_path / "checkpoint")


def test_a_restarted_filter_goes_on_and_knows_less(scenario, drive, ended, left) -> None:
    """Killed at 60 s, there again at 80 s, on a straight course. There may have been a manoeuvre:
    0.1 m/s² for 19 s is 1.9 m/s, 18 m then and 21 m in the 11 s since, along two axes."""
    _, *before = ended
    with bench(topics.UKF_FUSION, scenario(), checkpoint=str(left)) as made:
        drive(made, (80, 90))
        after = drive.error(made, 90), sigma(made)
        assert stamps(made, topics.NAV_FIX) == list(range(80, 91))
        assert made.told("19 IMU samples missing")
    assert after[0] < before[0] + 30.0
    assert after[1] == pytest.approx(math.hypot(before[1], math.sqrt(2.0) * 39.0), rel=0.03)
    assert after[0] < 3.0 * after[1]


def test_it_waits_for_the_time_of_its_start(scenario, drive) -> None:
    with bench(topics.UKF_FUSION, scenario(), start_time=10.0) as made:
        drive(made, (1, 12))
        assert made.told("waits for the start at 10.000 s")[0] == WARN
        assert stamps(made, topics.NAV_FIX) == [10, 11, 12]


@pytest.mark.parametrize(
    ("keys", "change", "first", "words"),
    [
        ((), {"run": 1}, 61, "another run or another scenario"),
        (("imu.grade=quantum",), {}, 61, "another run or another scenario"),
        ((), {"checkpoint_age": 100.0}, 300, "too old"),
        ((), {}, 30, "of a later time"),
    ],
)
def test_a_checkpoint_that_is_not_its_own_is_refused(
    scenario, drive, left, keys, change, first, words
) -> None:
    with bench(topics.UKF_FUSION, scenario(*keys), checkpoint=str(left), **change) as made:
        drive(made, (first, first + 1))
        assert made.told(words)[0] == ERROR
        assert made.heard["nav/fix"] == []


def pose_at(scenario, k: int, offset: float = 0.0):
    """A pose of the route at a stamp, east by an offset (m), with 1-sigma of 50 m."""
    trajectory = build_trajectory(scenario)
    message = topics.INITIAL_POSE.type()
    message.header.frame_id = MAP
    point = map_frame(scenario).from_geodetic(
        trajectory.latitude[k], trajectory.longitude[k], trajectory.height[k]
    )
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = point[0] + offset, point[1], point[2]
    heading = math.atan2(trajectory.velocity[k, 1], trajectory.velocity[k, 0])
    yaw = 0.5 * math.pi - heading
    turn.w, turn.z = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = 2500.0
    message.pose.covariance = covariance.ravel()
    return message


def variances(place: float, height: float, turn: float) -> np.ndarray:
    """A covariance (36,) of x and y, of z, and of the orientation."""
    return np.diag([place, place, height, turn, turn, turn]).ravel()


@pytest.mark.parametrize(("variance", "height"), [(0.0, 100.0), (4.0, 883.0)])
def test_the_height_of_a_pose_counts_where_it_has_a_variance(
    filtering, scenario, drive, variance, height
) -> None:
    """RViz gives z = 0 without one: 100 km from the origin that is 883 m above the ellipsoid."""
    drive(filtering, (1, 5))
    message = changed(pose_at(scenario(), 5), pose__covariance=variances(2500.0, variance, 0.0))
    place = message.pose.pose.position
    place.x, place.y, place.z = 1e5, 0.0, 0.0
    filtering.publish(topics.INITIAL_POSE, message)
    assert filtering.heard["nav/fix"][-1].altitude == pytest.approx(height, abs=5.0)


def test_late_or_again_without_a_checkpoint_it_waits_for_a_pose(
    filtering, scenario, drive
) -> None:
    """It once believed itself at the route's start, 31 km off, and said OK."""
    drive(filtering, (300, 302))
    said = "waits for a pose on initialpose: the data begin at 299.000 s"
    assert filtering.told(said)[0] == filtering.says()[-1][0] == ERROR
    assert filtering.heard["nav/fix"] == []
    filtering.publish(topics.INITIAL_POSE, pose_at(scenario(), 302, 20.0))
    assert filtering.told("placed")
    drive(filtering, (303, 310))
    assert drive.error(filtering, 310) < 60.0
    assert sigma(filtering) < 200.0
    assert filtering.says()[-1][0] == OK


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("header__frame_id", "base_link", "frame_id must be 'map'"),
        ("pose__pose__orientation__w", 5.0, "unit quaternion"),
        ("pose__covariance", np.zeros(36), "of x and y must be positive"),
        ("pose__covariance", np.full(36, math.nan), "not finite"),
        ("pose__covariance", variances(1e14, 0.0, 0.0), "at most 1e+12 m²"),
        ("pose__covariance", variances(2500.0, 0.0, 1e6), "orientation must be at most π²"),
        ("pose__covariance", variances(2500.0, 1.0, 0.0), "m, must be -12000 to 100000"),
    ],
)
def test_a_pose_that_cannot_be_used(filtering, scenario, drive, field, value, words) -> None:
    drive(filtering, (1, 5))
    far = 2e6 if "-12000" in words else 0.0
    message = changed(pose_at(scenario(), 5, far), **{field: value})
    filtering.publish(topics.INITIAL_POSE, message)
    assert filtering.told(words)
    assert filtering.node.health.dropped == {"initialpose": 1}
    assert drive.error(filtering, 5) < 200.0


def test_reset(scenario, drive, tmp_path) -> None:
    with bench(topics.UKF_FUSION, scenario(), checkpoint=str(tmp_path)) as made:
        drive(made, (1, 10))
        assert made.call("reset", Trigger.Request()).success
        made.heard["nav/fix"].clear()
        drive(made, (51, 52))
        assert made.told("waits for a pose")[0] == ERROR
        assert made.heard["nav/fix"] == []
        assert list(tmp_path.iterdir()) == []


def stamped(message, seconds: float):
    """A message of a stamp, s."""
    set_stamp(message.header.stamp, from_seconds(seconds))
    return message


def lose(made: Bench, drive, k: int) -> None:
    """Take a filter its covariance after sample k, and what it says once it finds out."""
    made.node.navigator.state.covariance[0, 1] = 1e30
    drive(made, (k + 1, k + 2))
    assert made.told("waits for a pose on initialpose: the filter's covariance is not")[0] == ERROR


@pytest.mark.parametrize("comeback", ["pose", "reset"])
def test_a_lost_covariance_is_said_once_and_left_by_pose_or_reset(
    scenario, drive, monkeypatch, tmp_path, comeback
) -> None:
    """It once published NaN until its end, and refused each pose for a height that is none."""
    said: list[str] = []
    monkeypatch.setattr(
        "isogal_ros.nodes.base.GraphNode.log", lambda _, level, text, **options: said.append(text)
    )
    with bench(
        topics.UKF_FUSION, scenario(), checkpoint=str(tmp_path), start_time=math.nan
    ) as made:
        drive(made, (1, 5))
        lose(made, drive, 5)
        assert not list(tmp_path.iterdir())  # nor does a restart go on from it
        made.fix(4, -0.6, 2.5)
        drive(made, (8, 9))
        assert stamps(made, topics.NAV_FIX)[-1] == 5
        assert sum("covariance is not" in text for text in said) == 2  # that of the sample as well
        if comeback == "pose":
            made.publish(topics.INITIAL_POSE, pose_at(scenario(), 9))
        else:
            made.call("reset", Trigger.Request())
        drive(made, (10, 12))
        assert stamps(made, topics.NAV_FIX)[-1] == 12
        made.node.health.renew()  # the period of the drop is over
        assert made.says()[-1][0] == OK
        published = [one.position_covariance for one in made.heard["nav/fix"]]
        assert np.isfinite(published).all()
        odometry = [one.pose.covariance for one in made.heard["nav/odom"]]
        assert np.isfinite(odometry).all()


def test_a_clock_that_is_set_is_no_gap_to_bridge(filtering, drive) -> None:
    """From 1970 to today it took steps until the memory was full."""
    drive(filtering, (1, 5))
    for k in range(1, 5):
        filtering.imu(1.7e9 + k, rate=(0.0, 0.0, 1e-6 * k))
    assert filtering.told("no IMU samples for 472222.2 h, or a clock was set")[0] == ERROR
    assert stamps(filtering, topics.NAV_FIX)[-1] == 5


def test_a_pose_is_taken_at_its_time(scenario, drive) -> None:
    """The vehicle goes 440 m in the 20 s that a pose is old; one ahead waits."""
    for stamp in (30, 55):
        with bench(topics.UKF_FUSION, scenario()) as made:
            drive(made, (1, 50))
            pose = stamped(pose_at(scenario(), stamp), stamp)
            made.publish(topics.INITIAL_POSE, pose)
            drive(made, (51, 60))
            assert made.node.health.dropped == {}
            assert drive.error(made, 60) < 60.0


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        (10.0, "stamp 10.0 s is older than the buffer"),
        (1.7e9, "stamp 1700000000.0 s is ahead of the navigator (50.0 s); 0 = now"),
    ],
)
def test_a_pose_of_a_time_that_nothing_is_known_of(scenario, drive, stamp, words) -> None:
    """RViz without use_sim_time stamps by the wall clock."""
    with bench(topics.UKF_FUSION, scenario(), horizon=20.0) as made:
        drive(made, (1, 50))
        made.publish(topics.INITIAL_POSE, stamped(pose_at(scenario(), 50, 5e3), stamp))
        assert made.told(words)[0] == WARN
        drive(made, (51, 52))
        assert drive.error(made, 52) < 200.0


def test_a_pose_before_the_first_sample_is_of_its_time_or_refused(
    filtering, scenario, drive
) -> None:
    filtering.publish(topics.INITIAL_POSE, stamped(pose_at(scenario(), 200), 200.0))
    drive(filtering, (300, 301))
    assert filtering.told("stamp 200.0 s, where the data begin at 299.0 s")
    assert filtering.told("waits for a pose")[0] == ERROR
    filtering.publish(topics.INITIAL_POSE, stamped(pose_at(scenario(), 304), 304.0))
    drive(filtering, (302, 310))
    assert stamps(filtering, topics.NAV_FIX)[0] == 305
    assert drive.error(filtering, 310) < 60.0


def turned(message, yaw: float):
    """A pose turned to the left by an angle (rad), as it is drawn in RViz: with a variance of yaw,
    and none of roll and pitch."""
    turn = message.pose.pose.orientation
    half = 0.5 * yaw + math.atan2(turn.z, turn.w)
    turn.w, turn.z = math.cos(half), math.sin(half)
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = 0.25
    covariance[5, 5] = 0.0685
    message.pose.covariance = covariance.ravel()
    return message


def test_a_heading_drawn_in_rviz_is_as_uncertain_as_it_says(filtering, scenario, drive) -> None:
    """It was taken for one to 0.3 mrad, and level for that of the map's plane."""
    drive(filtering, (1, 20))
    before = filtering.node.navigator.state.copy()
    filtering.publish(topics.INITIAL_POSE, turned(pose_at(scenario(), 20), 0.1))
    after = filtering.node.navigator.state
    roll, pitch, heading = to_angles(matrix(after.attitude))
    own = to_angles(matrix(before.attitude))
    assert (roll, pitch) == pytest.approx(own[:2], abs=1e-12)
    assert heading - own[2] == pytest.approx(-0.1, abs=2e-3)
    assert after.covariance[8, 8] == pytest.approx(0.0685, rel=1e-4)
    tilts = slice(6, 8)
    np.testing.assert_array_equal(after.covariance[tilts, tilts], before.covariance[tilts, tilts])


def test_a_pose_that_says_a_place_only_leaves_velocity_and_attitude(
    filtering, scenario, drive
) -> None:
    """Each pose once made the velocity of a navigator one to 25 % of its speed."""
    drive(filtering, (1, 20))
    before = filtering.node.navigator.state.copy()
    pose = changed(pose_at(scenario(), 20), pose__covariance=variances(2500.0, 9.0, 0.0))
    filtering.publish(topics.INITIAL_POSE, pose)
    after = filtering.node.navigator.state
    np.testing.assert_array_equal(after.velocity, before.velocity)
    np.testing.assert_array_equal(after.attitude, before.attitude)
    np.testing.assert_array_equal(after.covariance[3:, 3:], before.covariance[3:, 3:])
    assert not after.covariance[:3, 3:].any()
    np.testing.assert_allclose(np.diag(after.covariance)[:3], [2500.0, 2500.0, 9.0], rtol=1e-4)


def test_a_pose_without_heading_does_not_end_an_alignment(scenario) -> None:
    """It made the filter an aligned one, with a heading that may be any."""
    with bench(topics.UKF_FUSION, scenario("fusion.start=align")) as made:
        for k in range(1, 4):
            made.imu(k)
        pose = pose_at(scenario(), 3)
        made.publish(topics.INITIAL_POSE, pose)
        assert made.told("the variance of yaw must be positive: the heading is unknown")
        assert made.node.navigator is None
        made.publish(topics.INITIAL_POSE, turned(pose, 0.0))
        assert made.node.navigator.state.covariance[8, 8] == pytest.approx(0.0685, rel=1e-4)


def test_samples_without_a_stamp_are_said(filtering) -> None:
    """They were said to wait for the start at 0 s."""
    filtering.imu(0)
    filtering.imu(0)
    assert filtering.told("imu/data_raw: stamp is zero: not set")[0] == WARN
