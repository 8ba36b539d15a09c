"""Parts of the nodes without ROS underneath: lock-step, navigation buffer, diagnostics,
domains."""

import math
import socket
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatFix
from std_msgs.msg import Float64MultiArray

from ins_sim_node.lock_step import LockStep
from isogal.errors import InputError
from isogal.inertial.rotations import from_heading
from isogal.scenario import load_scenario
from isogal_ros import topics
from isogal_ros.graph.domain import DOMAIN, claim_domain, shared_memory, sweep_shared_memory
from isogal_ros.messages import convert
from isogal_ros.nodes.health import ERROR, OK, WARN, BadMessageError, Health, figures_of
from isogal_ros.nodes.nav_buffer import NavBuffer

S = 10**9
SCENARIO = load_scenario(None, ["matcher.batch_length=3"])


class TestLockStep:
    @pytest.fixture
    def step(self) -> LockStep:
        return LockStep(SCENARIO)

    def test_the_start_needs_no_answer(self, step) -> None:
        step.begin(0, 0)
        assert step.complete

    def test_a_plain_step_needs_the_navigator(self, step) -> None:
        step.begin(1, S)
        assert not step.complete
        assert not step.nav(0)  # the one before
        assert step.nav(S)
        assert step.complete
        assert not step.nav(S)  # completed only once

    def test_a_scan_needs_the_reading_too(self, step) -> None:
        step.begin(10, 10 * S)
        assert not step.nav(10 * S)
        assert "reading" in step.missing()
        assert not step.reading(9 * S)
        assert step.reading(10 * S)

    def test_a_batch_end_needs_the_fix_and_its_answer(self, step) -> None:
        step.begin(30, 30 * S)
        assert not step.nav(30 * S)
        assert not step.reading(30 * S)
        assert "pmht_mm/fix" in step.missing()
        assert not step.fix(30 * S)
        assert "nav/odom (1 of 2)" in step.missing()
        assert step.nav(30 * S)

    def test_the_order_of_the_answers_does_not_matter(self, step) -> None:
        step.begin(30, 30 * S)
        assert not step.fix(30 * S)
        assert not step.nav(30 * S)
        assert not step.nav(30 * S)
        assert step.reading(30 * S)

    def test_retrodiction_has_as_many_answers_as_fixes(self, step) -> None:
        step.begin(30, 30 * S)
        step.reading(30 * S)
        step.nav(30 * S)
        for ns in (10 * S, 20 * S, 30 * S):
            assert not step.fix(ns)
        assert not step.nav(30 * S)
        assert not step.nav(30 * S)
        assert step.nav(30 * S)


def nav_messages(
    ns: int,
    latitude: float,
    longitude: float,
    north: float = 10.0,
    east: float = 0.0,
    variance: float = 4.0,
):
    frame = convert.map_frame(SCENARIO)
    fix, odom, cov = NavSatFix(), Odometry(child_frame_id="base_link"), Float64MultiArray()
    fix.header.frame_id, odom.header.frame_id = "base_link", "map"
    matrix = np.diag([variance, variance, 0.01, 0.1, 0.1, 0.1, 1e-8, 1e-8, 1e-6])
    state = np.array([latitude, longitude, 100.0, north, east, 0.0, *from_heading(0.3)])
    convert.fill_fix(fix, ns, latitude, longitude, 100.0, matrix[:3, :3])
    convert.fill_odom(odom, ns, frame, state, np.zeros(3), matrix)
    convert.fill_numbers(cov, ns, np.arange(49.0).reshape(7, 7) + np.eye(7))
    return serialize_message(fix), serialize_message(odom), serialize_message(cov)


class Buffer:
    """A NavBuffer whose node is a stand-in."""

    def __init__(self, publishers: int = 1) -> None:
        self.handlers = {}
        self.arrivals = 0
        extra = SimpleNamespace(get_publisher_count=lambda: publishers)

        def listen(topic, handler, raw):
            assert raw
            self.handlers[topic.name] = handler
            return extra

        self.buffer = NavBuffer(SimpleNamespace(listen=listen), SCENARIO, self.arrived)

    def arrived(self) -> None:
        self.arrivals += 1

    def feed(self, ns: int, *place: float, covariance: bool = True, **more: float) -> None:
        fix, odom, cov = nav_messages(ns, *place, **more)
        if covariance:
            self.handlers[topics.NAV_COVARIANCE.name](cov)
        self.handlers[topics.NAV_FIX.name](fix)
        self.handlers[topics.NAV_ODOM.name](odom)


PLACE = (math.radians(-37.9), math.radians(144.6))


class TestNavBuffer:
    def test_the_state_of_a_stamp(self) -> None:
        buffer = Buffer()
        assert buffer.buffer.at(5 * S) is None
        buffer.feed(5 * S, *PLACE)
        sample = buffer.buffer.at(5 * S)
        assert (sample.latitude, sample.longitude) == pytest.approx(PLACE, abs=1e-15)
        assert sample.velocity == pytest.approx([10.0, 0.0, 0.0], abs=1e-12)
        assert sample.covariance.shape == (7, 7)
        assert sample.height_variance == 0.01
        assert buffer.arrivals == 3

    def test_it_waits_for_the_covariance_only_where_somebody_publishes_it(self) -> None:
        for publishers in (0, 1):
            buffer = Buffer(publishers)
            buffer.feed(5 * S, *PLACE, covariance=False)
            sample = buffer.buffer.at(5 * S)
            assert (sample is None) == (publishers == 1)
            if sample is not None:
                assert np.diag(sample.covariance) == pytest.approx([4.0, 4.0, 0.1, 0.1])

    def test_it_does_not_wait_for_ever(self) -> None:
        buffer = Buffer()
        buffer.feed(5 * S, *PLACE, covariance=False)
        assert buffer.buffer.at(5 * S) is None
        buffer.feed(6 * S, *PLACE)
        assert buffer.buffer.at(5 * S).covariance.shape == (4, 4)

    def test_a_stamp_between_two_states(self) -> None:
        buffer = Buffer()
        buffer.feed(5 * S, *PLACE)
        assert buffer.buffer.at(5 * S + S // 2) is None
        buffer.feed(6 * S, *PLACE)
        sample = buffer.buffer.at(5 * S + S // 2)
        assert (sample.latitude - PLACE[0]) * 6.36e6 == pytest.approx(5.0, abs=0.05)
        assert sample.longitude == pytest.approx(PLACE[1], abs=1e-15)

    def test_a_stamp_in_a_gap_is_said(self) -> None:
        buffer = Buffer()
        buffer.feed(5 * S, *PLACE)
        buffer.feed(20 * S, *PLACE)
        with pytest.raises(BadMessageError, match=r"said nothing about 12\.000 s"):
            buffer.buffer.at(12 * S)

    def test_a_second_message_of_a_stamp_is_a_jump(self) -> None:
        buffer = Buffer()
        buffer.feed(5 * S, *PLACE)
        buffer.feed(5 * S, PLACE[0] + 1e-5, PLACE[1], north=10.5)
        buffer.feed(5 * S, PLACE[0] + 1e-5, PLACE[1] - 1e-5, north=10.5, east=-1.0)
        buffer.feed(6 * S, *PLACE)
        first, second = buffer.buffer.take_jumps(6 * S)
        assert first.ns == second.ns == 5 * S
        assert first.change == pytest.approx([63.6, 0.0, 0.5, 0.0, 0, 0, 0], abs=0.1)
        assert second.change == pytest.approx([0.0, -50.3, 0.0, -1.0, 0, 0, 0], abs=0.1)
        assert buffer.buffer.at(5 * S).velocity[0] == pytest.approx(
            10.0
        )  # the state before any fix
        assert buffer.buffer.take_jumps(6 * S) == []

    def test_jumps_wait_for_their_scan(self) -> None:
        buffer = Buffer()
        buffer.feed(5 * S, *PLACE)
        buffer.feed(5 * S, PLACE[0] + 1e-5, PLACE[1])
        assert buffer.buffer.take_jumps(5 * S) == []
        assert len(buffer.buffer.take_jumps(5 * S + 1)) == 1

    def test_nothing_moved_is_no_jump(self) -> None:
        buffer = Buffer()
        buffer.feed(5 * S, *PLACE)
        buffer.feed(5 * S, *PLACE)
        assert buffer.buffer.jumps == []

    def test_topics_may_run_ahead_of_each_other(self) -> None:
        buffer = Buffer()
        pairs = [nav_messages(5 * S, PLACE[0] + i * 1e-5, PLACE[1]) for i in range(3)]
        buffer.handlers[topics.NAV_COVARIANCE.name](pairs[0][2])
        for fix, _, _ in pairs:
            buffer.handlers[topics.NAV_FIX.name](fix)
        assert buffer.buffer.at(5 * S) is None
        for _, odom, _ in pairs:
            buffer.handlers[topics.NAV_ODOM.name](odom)
        assert [jump.change[0] for jump in buffer.buffer.jumps] == pytest.approx(
            [63.6, 63.6], abs=0.1
        )
        assert buffer.buffer.at(5 * S).latitude == pytest.approx(PLACE[0], abs=1e-15)

    def test_old_states_are_given_up(self) -> None:
        buffer = Buffer()
        for i in range(1100):
            buffer.feed(i * S, *PLACE)
        with pytest.raises(BadMessageError, match="said nothing"):
            buffer.buffer.at(10 * S)
        with pytest.raises(BadMessageError, match="older than all that are kept"):
            buffer.feed(3 * S, *PLACE)
        assert buffer.buffer.at(1000 * S) is not None


class Listener:
    def __init__(self) -> None:
        self.arrays = []

    def publish(self, array) -> None:
        status = array.status[0]
        self.arrays.append((status.level, status.message, figures_of(status), len(array.status)))


class TestHealth:
    @pytest.fixture
    def out(self) -> Listener:
        return Listener()

    @pytest.fixture
    def health(self, out) -> Health:
        return Health("node", out, S)

    def test_once_a_period(self, health, out) -> None:
        for ns in range(0, 5 * S, S // 4):
            health.tick(ns)
        assert len(out.arrays) == 5

    def test_a_change_is_said_at_once(self, health, out) -> None:
        health.tick(0)
        health.state(OK, "running")
        health.state(OK, "running")
        health.state(ERROR, "broken")
        assert [(level, message) for level, message, *_ in out.arrays] == [
            (OK, "starting"),
            (OK, "running"),
            (ERROR, "broken"),
        ]

    def test_drops_are_counted_and_warned_of_for_a_period(self, health, out) -> None:
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

    def test_more_statuses(self, health, out) -> None:
        health.figures["error"] = 1.25
        health.publish(DiagnosticStatus(name="batch"))
        health.publish()
        assert [count for *_, count in out.arrays] == [2, 1]
        assert out.arrays[0][2] == {"error": "1.25"}


class TestDomain:
    def test_the_users_domain_is_taken(self, monkeypatch) -> None:
        monkeypatch.setenv(DOMAIN, "77")
        with claim_domain() as domain:
            assert domain == 77

    @pytest.mark.parametrize("value", ["-1", "233", "seven"])
    def test_no_such_domain(self, monkeypatch, value) -> None:
        monkeypatch.setenv(DOMAIN, value)
        with (
            pytest.raises(InputError, match="ROS_DOMAIN_ID: must be a number from 0 to 232"),
            claim_domain(),
        ):
            pass

    def test_two_graphs_get_two_domains(self, monkeypatch) -> None:
        monkeypatch.delenv(DOMAIN)
        with claim_domain() as first, claim_domain() as second:
            assert first != second
        with claim_domain() as third:
            assert third == first

    def test_a_domain_with_a_participant_is_not_free(self, monkeypatch) -> None:
        monkeypatch.delenv(DOMAIN)
        with claim_domain() as domain:
            pass
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
            participant.bind(("", 7410 + 250 * domain))
            with claim_domain() as other:
                assert other != domain

    def test_only_orphans_are_swept(self, monkeypatch, tmp_path) -> None:
        monkeypatch.setattr("isogal_ros.graph.domain._MEMORY", tmp_path)
        (tmp_path / "fastrtps_old").touch()
        before = shared_memory()
        (tmp_path / "fastrtps_orphan").touch()
        (tmp_path / "sem.fastrtps_orphan_mutex").touch()
        (tmp_path / "fastrtps_used").write_bytes(b"x")
        (tmp_path / "something else").touch()
        code = (
            f"stream = open({str(tmp_path / 'fastrtps_used')!r}); print('open', flush=True);"
            " input()"
        )
        command = [sys.executable, "-c", code]
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout.readline() == "open\n"
            sweep_shared_memory(before)
            process.communicate("\n")
        assert sorted(entry.name for entry in tmp_path.iterdir()) == [
            "fastrtps_old",
            "fastrtps_used",
            "something else",
        ]
