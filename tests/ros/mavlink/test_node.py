"""The navigator's position as MAVLink, read by pymavlink's own decoder from a socket."""

import math
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import ClockType
from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatStatus

from helpers.changed_messages import changed
from helpers.node_bench import Bench, bench, nav_messages
from isogal.errors import InputError
from isogal.matching.interfaces import Fix
from isogal_ros import topics
from isogal_ros.mavlink.decoding import SenderClock
from isogal_ros.mavlink.encoding import GPS_INPUT, SENSOR, VISION
from isogal_ros.mavlink.node import MAVLINK
from isogal_ros.messages.aids import read_position_fix, read_velocity
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.fix_information import FixMessage, fill_fix_information
from isogal_ros.messages.frames import BASE, NED_ENU, framed, map_frame
from isogal_ros.messages.imu import read_imu
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes.health import OK, WARN

common = pytest.importorskip("pymavlink.dialects.v20.common", reason="pymavlink is an extra")
PLACE = math.radians(-37.9), math.radians(144.6)


class Receiver:
    """A flight controller's socket on the loopback interface."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.address = "{}:{}".format(*self._socket.getsockname())
        self.close = self._socket.close

    def __call__(self, kind: str) -> list:
        """Messages of a kind that have come, decoded."""
        decoder, found = common.MAVLink(None), []
        while True:
            try:
                data = self._socket.recv(1000)
            except BlockingIOError:
                return [one for one in found if one.get_type() == kind]
            found += decoder.parse_buffer(data)


@pytest.fixture
def received():
    made = Receiver()
    yield made
    made.close()


def batch(made: Bench, seconds: float, lost: bool, published: bool) -> None:
    fix = Fix(seconds, *PLACE, np.eye(2), None if published else "no", reset=lost)
    message = topics.INFORMATION.type()
    fill_fix_information(message, from_seconds(seconds), FixMessage(fix))
    made.publish(topics.INFORMATION, message)


@contextmanager
def node(received, scenario, message: str, **own) -> Iterator[Bench]:
    """A node that knows that the navigator is aligned."""
    with bench(MAVLINK, scenario, address=received.address, message=message, **own) as made:
        nav_fix(made, NavSatStatus.STATUS_FIX)
        yield made


def nav_fix(made: Bench, status: int) -> None:
    """Publish what the navigator says of an early stamp on nav/fix."""
    message = framed(topics.NAV_FIX, BASE)
    fill_fix(message, 1, *PLACE, 100.0, np.eye(3), status)
    made.publish(topics.NAV_FIX, message)


def test_gps_input(received, scenario) -> None:
    with node(received, scenario(), GPS_INPUT) as made:
        made.nav(5.0, *PLACE, velocity=(10.0, -4.0))
        (found,) = received(GPS_INPUT)
    assert (found.lat, found.lon) == pytest.approx((-37.9e7, 144.6e7), abs=1)
    assert (found.vn, found.ve) == pytest.approx((10.0, -4.0), abs=1e-5)
    assert (found.horiz_accuracy, found.speed_accuracy) == pytest.approx((30.0, 0.1), rel=1e-6)
    assert (found.time_usec, found.fix_type) == (5_000_000, 3)
    assert found.ignore_flags & common.GPS_INPUT_IGNORE_FLAG_ALT
    assert not found.ignore_flags & common.GPS_INPUT_IGNORE_FLAG_HORIZONTAL_ACCURACY
    assert (found.get_srcSystem(), found.get_srcComponent()) == (1, 197)


def test_vision_position_estimate(received, scenario) -> None:
    place = np.add(np.radians(scenario().route.start), [1e-4, 2e-4])
    with node(received, scenario(), VISION) as made:
        made.nav(5.0, *place)
        (found,) = received(VISION)
    east, north, up = map_frame(made.scenario).from_geodetic(*place, 100.0)
    assert (found.x, found.y, found.z) == pytest.approx((north, east, -up), rel=1e-6)
    # from the north of the origin: where the vehicle is, north leans by the meridians' convergence
    assert found.yaw == pytest.approx(0.8 - 2e-4 * math.sin(place[0]), abs=1e-6)
    assert max(abs(found.roll), abs(found.pitch)) < 3e-4
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = found.covariance
    assert np.diag(upper) == pytest.approx([900, 900, 0.01, 1e-10, 1e-10, 1e-8], rel=0.01)


@pytest.mark.parametrize(("field", "source"), [("terrain", "TERRAIN"), ("gravity", "ESTIMATOR")])
def test_global_position_sensor(received, scenario, field, source) -> None:
    one = scenario(f"field={field}", *["gravimeter.sigma=1"] * (field != "gravity"))
    with node(received, one, SENSOR) as made:
        made.nav(5.0, *PLACE)
        (found,) = received(SENSOR)
    assert found.source == getattr(common, f"GLOBAL_POSITION_SRC_{source}")
    assert (found.lat, found.lon) == pytest.approx((-37.9e7, 144.6e7), abs=1)
    assert found.alt_ellipsoid == pytest.approx(100.0, abs=1.0)
    assert math.isnan(found.alt)
    assert (found.eph, found.epv) == pytest.approx((30.0, 0.1), rel=1e-3)
    assert (found.time_usec, found.flags) == (5_000_000, 0)


def test_it_is_silent_while_the_navigator_is_not_aligned_or_has_diverged(received, scenario):
    def sent(seconds: float) -> list:
        made.publish(*nav_messages(made.scenario, from_seconds(seconds), *PLACE)[-1])
        return received(VISION)

    with node(received, scenario(), VISION) as made:
        nav_fix(made, NavSatStatus.STATUS_NO_FIX)
        assert not sent(0.5)
        assert made.says()[-1][:2] == (WARN, "silent: the navigator is not aligned")
        made.nav(1.0, *PLACE)
        assert len(received(VISION)) == 1
        batch(made, 1.0, lost=True, published=False)
        assert not sent(2.0)
        assert made.says()[-1][:2] == (WARN, "silent: the navigator has diverged")
        batch(made, 2.0, lost=False, published=True)
        made.nav(2.5, *PLACE)  # not yet after the fix
        assert not received(VISION)
        made.nav(2.5, *PLACE)
        (found,) = received(VISION)
        assert found.reset_counter == 1


def test_another_likelier_place_silences_it_but_not_another_graphs(received, scenario) -> None:
    said = ("boat/pmht_mm_node", "0.9", 1), ("pmht_mm_node", "0.9", 0), ("pmht_mm_node", "0.2", 1)
    with node(received, scenario(), VISION) as made:
        for seconds, (name, diverged, count) in enumerate(said, 5):
            figures = [KeyValue(key="diverged", value=diverged)]
            status = DiagnosticStatus(name=f"{name}: batch", values=figures)
            made.publish(topics.DIAGNOSTICS, DiagnosticArray(status=[status]))
            made.nav(seconds, *PLACE)
            assert len(received(VISION)) == count


@pytest.mark.parametrize(("message", "count"), [(GPS_INPUT, 10), ("", 0)])
def test_rate_and_heartbeat(received, scenario, message, count) -> None:
    """Of stamps that jitter by 20 ms as many go on as are asked for. A lone receiver sends nothing
    but heartbeats."""
    times = [1.01 + 0.05 * k - 0.01 * (k % 3) for k in range(100)]
    with node(received, scenario(), message, rate=2.0) as made:
        for time in times:
            made.nav(time, *PLACE)
        sent = [1e-6 * one.time_usec for one in received(GPS_INPUT)]
        assert sent == pytest.approx(times[::10][:count])
        made.bus.tick()
        made.node._beat()
        (beat,) = received("HEARTBEAT")[-1:]
        assert beat.type == common.MAV_TYPE_ONBOARD_CONTROLLER


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"message": "ODOMETRY"}, "isogal_mavlink: message"),
        ({"address": "x"}, "address: must be host:port"),
        ({"receive": "127.0.0.1:14999", "sensors": ["IMU"]}, "sensors: must be of HIGHRES_IMU"),
        ({"receive": "127.0.0.1:14999", "sensors": ["RAW_IMU", "SCALED_IMU"]}, "for one topic"),
        ({"receive": "192.0.2.1:14999"}, "receive: 192.0.2.1:14999: "),
    ],
)
def test_bad_parameters(scenario, own, words) -> None:
    with pytest.raises(InputError, match=words), bench(MAVLINK, scenario(), **own):
        pass


class Autopilot:
    """Sends messages of a vehicle to a node on a bench, and lets it take them."""

    def __init__(self, made: Bench) -> None:
        self.bench = made
        host, port = made.node.settings.receive.split(":")
        self._to = host, int(port)

    def send(self, *messages, system: int = 1, component: int = 1, spoil: bool = False) -> None:
        sender = common.MAVLink(None, system, component)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for message in messages:
                data = bytearray(message.pack(sender))
                data[-3] ^= spoil  # within what the checksum covers
                out.sendto(data, self._to)
        self.bench.bus.now += 0.01
        self.bench.bus.tick()

    def heard(self, topic):
        return self.bench.heard[topic.name]


@contextmanager
def autopilot_of(scenario, **own) -> Iterator[Autopilot]:
    """An autopilot whose sensors a node takes at a port that is free."""
    free = Receiver()
    free.close()
    with bench(MAVLINK, scenario(), receive=free.address, message="", **own) as made:
        yield Autopilot(made)


def highres_imu(microseconds: int, force, rate, updated: int = 63):
    return common.MAVLink_highres_imu_message(
        microseconds, *force, *rate, 0, 0, 0, 1013.0, 0, 0, 20.0, updated
    )


def test_the_sensors_of_an_autopilot(scenario) -> None:
    with autopilot_of(scenario) as autopilot:
        # with `use_sim_time` and without /clock a timer of the node's clock stands still
        (timer,) = (one for one in autopilot.bench.node.timers if one.timer_period_ns == 5_000_000)
        assert timer.clock.clock_type == ClockType.STEADY_TIME
        for k in range(3):
            autopilot.send(highres_imu(7_000_000 + 5000 * k, (0.1, 0.2, -9.8), (1e-3, 2e-3, 3e-3)))
        autopilot.send(common.MAVLink_scaled_pressure_message(7020, 990.5, 0.0, 2000))
        autopilot.send(
            common.MAVLink_gps_raw_int_message(
                7_020_000, 3, -379000000, 1446000000, 55_000, 90, 90, 1000, 9000, 12,
                60_000, 1500, 2500, 200,
            )
        )  # fmt: skip
        imu, fixes = autopilot.heard(topics.IMU), autopilot.heard(topics.GNSS_FIX)
        (pressure,), (velocity,) = map(autopilot.heard, (topics.BAROMETER, topics.GNSS_VELOCITY))
    force, rate, _ = read_imu(serialize_message(imu[0]))
    assert [*force, *rate] == pytest.approx([0.1, 0.2, -9.8, 1e-3, 2e-3, 3e-3])
    stamps = [to_ns(one.header.stamp) for one in imu]
    assert np.diff(stamps).tolist() == [5_000_000, 5_000_000]
    assert stamps[0] == 10_000_000  # when it came
    assert to_ns(pressure.header.stamp) - stamps[0] == 20_000_000
    assert pressure.fluid_pressure == pytest.approx(99050.0)
    place, covariance = read_position_fix(fixes[0])
    assert place == pytest.approx([*PLACE, 60.0])
    assert np.sqrt(np.diag(covariance)) == pytest.approx([1.5, 1.5, 2.5])
    speed, of_speed = read_velocity(velocity, "", NED_ENU)
    np.testing.assert_allclose(speed, [0.0, 10.0, np.nan], atol=1e-12)
    assert of_speed[0, 0] == pytest.approx(0.04)


def test_ardupilots_units_and_a_velocity(scenario) -> None:
    with autopilot_of(scenario, sensors=["RAW_IMU", "ODOMETRY"]) as autopilot:
        raw = common.MAVLink_raw_imu_message(7_000_000, 10, 20, -1000, 1, 2, 3, 0, 0, 0)
        upper = np.zeros((6, 6))
        upper[0, 0], upper[1, 1], upper[2, 2], upper[0, 1] = 0.01, 0.04, 0.09, 0.002
        moved = common.MAVLink_odometry_message(
            7_000_000, 1, 12, 0, 0, 0, [1, 0, 0, 0], 9.0, -1.0, 0.5, 0, 0, 0,
            [math.nan] * 21, upper[np.triu_indices(6)].tolist(),
        )  # fmt: skip
        autopilot.send(raw, moved)
        (imu,), (velocity,) = map(autopilot.heard, (topics.IMU, topics.VELOCITY))
    force, rate, _ = read_imu(serialize_message(imu))
    assert [*force, *rate] == pytest.approx([0.0980665, 0.196133, -9.80665, 1e-3, 2e-3, 3e-3])
    found, covariance = read_velocity(velocity)
    assert found == pytest.approx([9.0, -1.0, 0.5])
    expected = [[0.01, 0.002, 0.0], [0.002, 0.04, 0.0], [0.0, 0.0, 0.09]]
    np.testing.assert_allclose(covariance, expected, atol=1e-8)


def test_what_is_not_taken(scenario) -> None:
    """Another system's messages, damaged ones, those that are not wanted, a sample that is old."""
    sample = (0.0, 0.0, -9.8), (0.0, 0.0, 0.0)
    with autopilot_of(scenario) as autopilot:
        autopilot.send(highres_imu(1, *sample), system=2)
        autopilot.send(highres_imu(2, *sample), spoil=True)
        autopilot.send(common.MAVLink_raw_imu_message(3, 0, 0, -1000, 0, 0, 0, 0, 0, 0))
        autopilot.send(highres_imu(4, *sample, updated=1))
        assert not autopilot.heard(topics.IMU)
        _, text, _ = autopilot.bench.told("without new accelerometers")
        autopilot.send(highres_imu(5, *sample))
        assert len(autopilot.heard(topics.IMU)) == 1
        autopilot.send(common.MAVLink_gps_raw_int_message(6, 1, 0, 0, 0, 0, 0, 0, 0, 0))
        assert read_position_fix(autopilot.heard(topics.GNSS_FIX)[0]) is None
        assert not autopilot.heard(topics.GNSS_VELOCITY)
    assert "imu/data_raw" in text


def test_of_two_sensors_that_send_the_same_one_is_used(scenario) -> None:
    """Of another IMU of the autopilot, or of another component; another takes over where the
    first is gone."""
    first, second = (highres_imu(k, (0.0, 0.0, -9.8), (0.0, 0.0, 0.0)) for k in (1, 2))
    second.id = 1
    with autopilot_of(scenario) as autopilot:
        autopilot.send(first, second)
        autopilot.send(first, component=191)
        assert len(autopilot.heard(topics.IMU)) == 1
        assert autopilot.bench.told("component 191, id 0: component 1, id 0 is used")[0] == WARN
        autopilot.bench.bus.now += 6.0
        autopilot.send(second)
        assert len(autopilot.heard(topics.IMU)) == 2


def test_it_says_what_does_not_come_until_it_does(scenario) -> None:
    """Nothing, another system, another message; and then what is wanted."""
    sample = highres_imu(1, (0.0, 0.0, -9.8), (0.0, 0.0, 0.0))
    raw = common.MAVLink_raw_imu_message(3, 0, 0, -1000, 0, 0, 0, 0, 0, 0)
    cases = (
        ({}, (), "no HIGHRES_IMU of system 1; others that come: none"),
        ({"system": 2}, (sample,), "others that come: HIGHRES_IMU of system 2"),
        ({}, (raw,), "others that come: RAW_IMU of system 1"),
        ({}, (sample,), None),
    )
    with autopilot_of(scenario, sensors=["HIGHRES_IMU"]) as autopilot:
        for options, messages, words in cases:
            autopilot.bench.bus.now += 6.0
            autopilot.send(*messages, **options)
            autopilot.bench.node._beat()
            level, text, _ = autopilot.bench.says()[-1]
            assert (level == WARN) == (words is not None)
            assert words is None or words in text


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("pose__pose__position__x", math.nan),
        ("pose__pose__orientation__w", math.nan),
        ("pose__covariance", np.full(36, math.nan)),
    ],
)
def test_a_state_that_is_not_finite_is_not_sent(received, scenario, field, value):
    with node(received, scenario(), VISION) as made:
        odometry = nav_messages(made.scenario, from_seconds(1.0), *PLACE)[-1][1]
        made.publish(topics.NAV_ODOM, changed(odometry, **{field: value}))
        assert not received(VISION)
        assert made.node.health.dropped == {"nav/odom": 1}


def test_it_says_that_the_navigator_is_gone_until_it_is_back(received, scenario) -> None:
    with node(received, scenario(), VISION) as made:
        for seconds, gone in ((1.0, False), (7.0, True), (8.0, False)):
            if not gone:
                made.nav(seconds, *PLACE)
            made.bus.now += 6.0 if gone else 0.0
            made.node._beat()
            level, text, _ = made.says()[-1]
            assert ("nothing on nav/odom, so nothing is sent" in text) == gone
            assert (level == WARN) == gone


def test_a_host_is_looked_up_beside_the_node(received, scenario, monkeypatch) -> None:
    """Each datagram was once sent to the name, which the system looked up each time."""
    asked, known = [], threading.Event()

    def look_up(name: str) -> str:
        asked.append(name)
        if not known.is_set():
            raise socket.gaierror(-2, "Name or service not known")
        return "127.0.0.1"

    monkeypatch.setattr("socket.gethostbyname", look_up)
    monkeypatch.setattr("isogal_ros.mavlink.destination.AGAIN", 0.01)
    received.address = received.address.replace("127.0.0.1", "autopilot.local")
    with node(received, scenario(), VISION) as made:
        made.nav(1.0, *PLACE)
        assert made.told("autopilot.local:")[1].endswith("Name or service not known")
        known.set()
        made.wait(lambda: made.node._to.address, "the address")
        made.nav(2.0, *PLACE)
        assert made.says()[-1][:2] == (OK, "sending")
        assert len(received(VISION)) == 1
    assert set(asked) == {"autopilot.local"}


def test_times_since_1970_and_since_the_start() -> None:
    clock, now = SenderClock(), 1_700_000_000 * 10**9
    assert clock.stamp(now - 7, now) == now - 7
    assert clock.stamp(5 * 10**9, now) == now
    assert clock.stamp(6 * 10**9, now + 2 * 10**9) == now + 10**9  # late on its way
    assert clock.stamp(5_500_000_000, now + 3 * 10**9) == now + 500_000_000  # out of order
    assert clock.stamp(10**8, now + 60 * 10**9) == now + 60 * 10**9  # started anew
    with pytest.raises(BadMessageError, match="no such time: 18446744073709 s"):
        clock.stamp((2**64 - 1) * 1000, now)
