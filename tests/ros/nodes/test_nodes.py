"""Single nodes: what they answer, and that no message ends them."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import NavSatStatus

from helpers.node_bench import bench
from isogal.earth.frames import horizontal_difference
from isogal.inertial.strapdown import propagate
from isogal.sensors.imu import simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.convert import read_accel, read_position
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes.health import ERROR, OK, WARN

pytestmark = pytest.mark.ros


@pytest.fixture
def filter_bench(scenario):
    with bench(topics.UKF_FUSION, scenario()) as made:
        yield made


@pytest.fixture
def start(scenario):
    state = draw_initial_state(scenario(), build_trajectory(scenario()), [0])
    return float(state.position[0, 0]), float(state.position[0, 1])


def stamps(bench, topic) -> list[int]:
    return [to_ns(message.header.stamp) // 10**9 for message in bench.heard[topic.name]]


class TestFilter:
    def test_every_sample_is_answered(self, filter_bench) -> None:
        for k in range(1, 6):
            filter_bench.imu(k)
        filter_bench.wait(lambda: len(filter_bench.heard["nav/fix"]) == 6)
        filter_bench.settle()
        for topic in (topics.NAV_FIX, topics.NAV_ODOM):
            assert stamps(filter_bench, topic) == [0, 1, 2, 3, 4, 5]  # with the start
        assert len(filter_bench.heard["nav/covariance"]) == 6
        assert len(filter_bench.heard["nav/path"]) == 1

    def test_it_navigates_as_the_library_does(self, scenario, filter_bench) -> None:
        trajectory = build_trajectory(scenario())
        imu = simulate_imu(scenario(), trajectory, [0])
        for k in range(30):
            filter_bench.imu(
                k + 1, tuple(imu.specific_force[0, k])
            )  # rates of zero: only the order of magnitude counts
        filter_bench.wait(lambda: len(filter_bench.heard["nav/fix"]) == 31)
        state = draw_initial_state(scenario(), trajectory, [0])
        force = imu.specific_force[:, :30]
        end, _ = propagate(state, force, np.zeros_like(force), 1.0, trajectory.height[:31])
        got = read_position(filter_bench.heard["nav/fix"][-1])
        off = horizontal_difference(got[0], got[1], end.position[0, 0], end.position[0, 1])
        assert np.hypot(*off) < 0.01

    def test_a_fix_moves_it_and_is_answered(self, filter_bench, start) -> None:
        filter_bench.imu(1)
        filter_bench.imu(2)
        filter_bench.wait(lambda: len(filter_bench.heard["nav/fix"]) == 3)
        before = read_position(filter_bench.heard["nav/fix"][-1])
        filter_bench.fix(2, before[0] + 1e-5, before[1], variance=1.0)
        filter_bench.wait(lambda: len(filter_bench.heard["nav/fix"]) == 4)
        after = read_position(filter_bench.heard["nav/fix"][-1])
        assert (after[0] - before[0]) / 1e-5 == pytest.approx(1.0, abs=0.01)
        assert stamps(filter_bench, topics.NAV_FIX) == [0, 1, 2, 2]
        assert filter_bench.says()[-1][0] == OK

    def test_a_late_fix_equals_one_in_time(self, scenario, start) -> None:
        results = []
        for late in (False, True):
            with bench(topics.UKF_FUSION, scenario()) as made:
                for k in range(1, 21):
                    made.imu(k, (0.1, 0.02 * k, -9.8))
                    if k == (20 if late else 8):
                        made.wait(lambda made=made, k=k: made.node.samples == k)
                        made.fix(8, start[0] + 1e-5, start[1] - 1e-5)
                        made.wait(lambda made=made: made.node.answered == 1)
                made.wait(lambda made=made: len(made.heard["nav/fix"]) == 22)
                results.append(read_position(made.heard["nav/fix"][-1]))
        assert horizontal_difference(*results[0][:2], *results[1][:2]) == pytest.approx(
            [0, 0], abs=1e-6
        )

    @pytest.mark.parametrize(
        ("send", "topic", "words"),
        [
            (lambda b: b.imu(3, (math.nan, 0.0, -9.8)), "imu/data_raw", "not finite"),
            (lambda b: b.imu(3, frame="camera"), "imu/data_raw", "frame_id must be 'base_link'"),
            (lambda b: b.imu(1), "imu/data_raw", "not later than"),
            (lambda b: b.imu(2), "imu/data_raw", "not later than"),
            (lambda b: b.imu(3, (1e9, 0.0, 0.0)), "imu/data_raw", "above 1000"),
            (lambda b: b.fix(2, math.nan, 0.0), "pmht_mm/fix", "not finite"),
            (lambda b: b.fix(2, -0.6, 2.5, variance=-1.0), "pmht_mm/fix", "negative variance"),
            (lambda b: b.fix(2, -0.6, 2.5, variance=0.0), "pmht_mm/fix", "not positive definite"),
            (lambda b: b.fix(2, -0.6, 2.5, frame="antenna"), "pmht_mm/fix", "frame_id must be"),
            (lambda b: b.fix(99, -0.6, 2.5), "pmht_mm/fix", "ahead of the navigator"),
        ],
    )
    def test_bad_messages_are_dropped_and_said(self, filter_bench, send, topic, words) -> None:
        filter_bench.imu(1)
        filter_bench.imu(2)
        filter_bench.wait(lambda: filter_bench.node.samples == 2)
        send(filter_bench)
        filter_bench.wait(
            lambda: any(words in message for _, message, _ in filter_bench.says()), words
        )
        level, message, figures = next(item for item in filter_bench.says() if words in item[1])
        assert level == WARN
        assert topic in message
        assert figures[f"dropped {topic}"] == "1"
        # and it goes on
        filter_bench.imu(3)
        filter_bench.imu(4)
        filter_bench.wait(lambda: 4 in stamps(filter_bench, topics.NAV_FIX))
        position = read_position(filter_bench.heard["nav/fix"][-1])
        assert np.isfinite(position).all()
        assert not filter_bench.node.finished

    def test_lost_samples_are_bridged_and_counted(self, filter_bench) -> None:
        for k in (1, 2, 5, 6):
            filter_bench.imu(k)
        filter_bench.wait(lambda: 6 in stamps(filter_bench, topics.NAV_ODOM))
        filter_bench.settle()
        warnings = [item for item in filter_bench.says() if item[0] == WARN]
        assert "2 IMU samples missing" in warnings[0][1]
        assert filter_bench.says()[-1][2]["IMU samples missing"] == "2"
        assert filter_bench.says()[-1][0] == OK  # over when the next sample is in time

    def test_a_long_gap_is_an_error(self, filter_bench) -> None:
        for k in (1, 2, 60):
            filter_bench.imu(k)
        filter_bench.wait(lambda: any(level == ERROR for level, *_ in filter_bench.says()))
        filter_bench.wait(lambda: 60 in stamps(filter_bench, topics.NAV_ODOM))

    def test_no_fix_is_answered_too(self, filter_bench, start) -> None:
        filter_bench.imu(1)
        filter_bench.wait(lambda: filter_bench.node.samples == 1)  # topics may overtake each other
        filter_bench.fix(1, *start, status=NavSatStatus.STATUS_NO_FIX)
        filter_bench.wait(lambda: len(filter_bench.heard["nav/fix"]) == 3)
        assert filter_bench.node.answered == 1

    def test_a_given_start(self, scenario) -> None:
        own = {
            "start_position": [-35.0, 149.0, 50.0],
            "start_velocity": [1.0, 2.0, 0.0],
            "start_attitude": [0.0, 0.0, 90.0],
        }
        with bench(topics.UKF_FUSION, scenario(), **own) as made:
            made.imu(1_700_000_000)  # stamps of the wall clock
            made.wait(lambda: len(made.heard["nav/fix"]) == 2)
            first = made.heard["nav/fix"][0]
            assert (first.latitude, first.longitude, first.altitude) == pytest.approx(
                (-35.0, 149.0, 50.0)
            )
            twist = made.heard["nav/odom"][0].twist.twist.linear
            assert (twist.x, twist.y) == pytest.approx(
                (2.0, 1.0)
            )  # nose to the east: forward is east, left is north


class TestMatcher:
    @pytest.fixture
    def matcher_bench(self, scenario):
        with bench(topics.PMHT_MM, scenario()) as made:
            yield made

    @pytest.fixture
    def drive(self, scenario, matcher_bench):
        trajectory = build_trajectory(scenario())
        from isogal.fields.scenario_map import map_for_scenario

        field_map = map_for_scenario(scenario())

        def go(scan: int, value: float | None = None, nav: bool = True, **keys) -> None:
            k = scan * 10
            place = float(trajectory.latitude[k]), float(trajectory.longitude[k])
            if nav:
                matcher_bench.nav(k, *place, tuple(trajectory.velocity[k, :2]))
            if value is None:
                value = float(field_map.value(*place))
            matcher_bench.reading(k, value, **keys)

        return go

    def test_a_batch_gives_a_fix_where_it_is(self, matcher_bench, drive, scenario) -> None:
        for scan in range(1, 7):
            drive(scan)
        matcher_bench.wait(lambda: matcher_bench.heard["pmht_mm/fix"])
        matcher_bench.settle()
        (fix,) = matcher_bench.heard["pmht_mm/fix"]
        assert to_ns(fix.header.stamp) == from_seconds(60.0)
        assert fix.status.status == NavSatStatus.STATUS_FIX
        trajectory = build_trajectory(scenario())
        off = horizontal_difference(
            *read_position(fix)[:2], trajectory.latitude[60], trajectory.longitude[60]
        )
        assert np.hypot(*off) < 200.0  # the navigator's prior is 30 m
        (cloud,) = matcher_bench.heard["pmht_mm/candidates"]
        assert cloud.width > 0
        batch = [
            item
            for array in matcher_bench.heard["/diagnostics"]
            for item in array.status
            if item.name.endswith("batch")
        ]
        assert len(batch) == 1

    def test_readings_may_come_before_the_navigators_state(
        self, matcher_bench, drive, scenario
    ) -> None:
        trajectory = build_trajectory(scenario())
        for scan in range(1, 7):
            drive(scan, nav=False)
        matcher_bench.wait(lambda: matcher_bench.node.taken == 6)
        assert len(matcher_bench.node.scans.waiting) == 6
        for scan in range(1, 7):
            k = scan * 10
            matcher_bench.nav(
                k,
                trajectory.latitude[k],
                trajectory.longitude[k],
                tuple(trajectory.velocity[k, :2]),
            )
        matcher_bench.wait(lambda: matcher_bench.heard["pmht_mm/fix"])
        assert matcher_bench.node.scans.waiting == []

    @pytest.mark.parametrize(
        ("keys", "words"),
        [
            ({"value": math.nan}, "not finite"),
            ({"variance": -1.0}, "negative variance"),
            ({"frame": "camera"}, "frame_id must be 'gravimeter_link'"),
        ],
    )
    def test_a_bad_reading_leaves_a_batch_of_the_same_length(
        self, matcher_bench, drive, keys, words
    ) -> None:
        for scan in range(1, 7):
            drive(scan, **(keys if scan == 3 else {}))
        matcher_bench.wait(lambda: matcher_bench.heard["pmht_mm/fix"])
        assert any(
            level == WARN and words in message for level, message, _ in matcher_bench.says()
        )
        assert to_ns(matcher_bench.heard["pmht_mm/fix"][0].header.stamp) == from_seconds(60.0)

    def test_a_lost_reading_leaves_a_batch_of_the_same_length(self, matcher_bench, drive) -> None:
        for scan in (1, 2, 4, 5, 6):
            if scan == 4:  # the navigator has spoken, the gravimeter was not heard
                matcher_bench.nav(30, -0.637, 2.5656)
            drive(scan)
        matcher_bench.wait(lambda: matcher_bench.heard["pmht_mm/fix"])
        matcher_bench.settle()
        assert to_ns(matcher_bench.heard["pmht_mm/fix"][0].header.stamp) == from_seconds(60.0)
        assert matcher_bench.says()[-1][2]["scans missing"] == "1"

    def test_stamps_must_increase(self, matcher_bench, drive) -> None:
        drive(2)
        drive(1)
        drive(2)
        matcher_bench.wait(lambda: matcher_bench.node.taken == 3)
        assert matcher_bench.node.health.dropped == {"gravimeter/disturbance": 2}

    def test_a_matcher_that_fails_is_answered_for(self, matcher_bench, drive, monkeypatch) -> None:
        class Broken:
            context = 0

            def match(self, *_):
                raise ZeroDivisionError("division by zero")

        monkeypatch.setattr(matcher_bench.node, "_matcher", Broken())
        for scan in range(1, 7):
            drive(scan)
        matcher_bench.wait(lambda: matcher_bench.heard["pmht_mm/fix"])
        (fix,) = matcher_bench.heard["pmht_mm/fix"]
        assert fix.status.status == NavSatStatus.STATUS_NO_FIX
        batch = [
            item
            for array in matcher_bench.heard["/diagnostics"]
            for item in array.status
            if item.name.endswith("batch")
        ]
        assert batch[0].message == "the matcher failed: ZeroDivisionError: division by zero"

    def test_settings_may_change_between_batches(self, matcher_bench) -> None:
        from rclpy.parameter import Parameter

        node = matcher_bench.node
        assert node.set_parameters([Parameter("matcher.map_sigma", value=3e-5)])[0].successful
        assert node.scenario.matcher.map_sigma == 3e-5
        refused = node.set_parameters([Parameter("matcher.options", value="{no_such_option: 1}")])[
            0
        ]
        assert not refused.successful
        assert "no_such_option" in refused.reason
        assert node.scenario.matcher.options == {}


class TestGravimeter:
    def test_an_instruments_readings_are_reduced(self, scenario) -> None:
        from isogal.sensors.gravimeter import reduce_disturbance, reduce_gravity

        place = (-0.637, 2.5656)
        with bench(topics.GRAVIMETER, scenario(), simulate=False) as made:
            made.reading(10.0, 9.7952, topic=topics.FELT)
            made.nav(10.0, *place, (12.0, 15.0))
            made.wait(lambda: made.heard["gravimeter/disturbance"])
            for name, reduce in (
                ("gravimeter/gravity", reduce_gravity),
                ("gravimeter/disturbance", reduce_disturbance),
            ):
                value, variance = read_accel(made.heard[name][0])
                assert value == pytest.approx(
                    float(reduce(9.7952, place[0], 100.0, 12.0, 15.0)), abs=1e-15
                )
                assert variance > 1e-10 + (0.1 * 3.086e-6) ** 2  # sensor, height, and more

    def test_without_navigator_the_scan_is_known_to_be_empty(self, scenario) -> None:
        with bench(topics.GRAVIMETER, scenario(), simulate=False) as made:
            made.nav(1.0, -0.637, 2.5656)
            made.nav(90.0, -0.637, 2.5656)
            made.reading(10.0, 9.7952, topic=topics.FELT)
            made.wait(lambda: made.heard["gravimeter/gravity"])
            assert math.isnan(made.heard["gravimeter/gravity"][0].accel.accel.linear.z)
            assert any("said nothing about 10.000 s" in message for _, message, _ in made.says())

    def test_it_feels_at_its_own_scans_only(self, scenario) -> None:
        with bench(topics.GRAVIMETER, scenario()) as made:
            message = topics.TRUTH_FIX.type()
            for k in range(1, 25):
                message.header.stamp.sec = k
                made.publish(topics.TRUTH_FIX, message)
            made.wait(lambda: len(made.heard["gravimeter/data_raw"]) == 2)
            assert stamps(made, topics.FELT) == [10, 20]


class TestSimulator:
    def test_it_says_whom_it_waits_for(self, scenario) -> None:
        with bench(
            topics.INS_SIM, scenario(), peers=list(topics.NODES), start_timeout=0.5
        ) as made:
            made.wait(lambda: made.node.finished)
            assert made.node.exit_code == 1
            assert "cannot begin after 0.5 s" in made.node.failure
            assert "ukf_fusion_node is not ready" in made.node.failure
            made.wait(lambda: made.says() and made.says()[-1][0] == ERROR)

    def test_it_does_not_wait_for_ever_for_an_answer(self, scenario) -> None:
        with bench(topics.INS_SIM, scenario(), rate=0.0, reply_timeout=0.5) as made:
            made.wait(lambda: made.node.finished)
            assert (
                "no answer to the step at 1.000 s within 0.5 s: missing nav/odom (0 of 1)"
                in made.node.failure
            )
            assert made.node.exit_code == 1
            assert made.heard["ground_truth/fix"]

    def test_without_lock_step_it_keeps_its_rate(self, scenario) -> None:
        with bench(
            topics.INS_SIM, scenario("route.duration=20.0"), rate=200.0, lock_step=False
        ) as made:
            made.wait(lambda: made.node.finished)
            made.settle()
            assert stamps(made, topics.IMU) == list(range(1, 21))
            assert stamps(made, topics.TRUTH_FIX) == list(range(21))
            assert len(made.heard["/clock"]) == 21
            assert made.node.exit_code == 0

    def test_rate_may_change(self, scenario) -> None:
        from rclpy.parameter import Parameter

        with bench(
            topics.INS_SIM, scenario("route.duration=30.0"), rate=0.01, lock_step=False
        ) as made:
            made.wait(lambda: made.node.step == 0)
            assert made.node.set_parameters([Parameter("rate", value=500)])[0].successful
            made.wait(lambda: made.node.finished)
            assert not made.node.set_parameters([Parameter("rate", value=-1.0)])[0].successful
