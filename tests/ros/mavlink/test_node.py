"""The navigator's position as MAVLink, read by pymavlink's own decoder from a socket."""

import math
import socket

import numpy as np
import pytest

from helpers.node_bench import Bench, bench
from isogal.earth.frames import LocalFrame
from isogal.matching.interfaces import Fix
from isogal_ros import topics
from isogal_ros.mavlink.encoding import GPS_INPUT, VISION
from isogal_ros.mavlink.node import MAVLINK
from isogal_ros.mavlink.silence import Silence
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.messages.whole_fix import WholeFix, fill_whole_fix
from isogal_ros.nodes.health import WARN

common = pytest.importorskip("pymavlink.dialects.v20.common", reason="pymavlink is an extra")
PLACE = math.radians(-37.9), math.radians(144.6)


@pytest.fixture
def receiver():
    """A socket on the loopback interface, and its address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        made.setblocking(False)
        yield made


def received(receiver, kind: str):
    """Messages of a kind that have come, decoded."""
    decoder, found = common.MAVLink(None), []
    while True:
        try:
            data = receiver.recv(1000)
        except BlockingIOError:
            return [one for one in found if one.get_type() == kind]
        found += decoder.parse_buffer(data)


def node(receiver, scenario, message: str, **own):
    address = "{}:{}".format(*receiver.getsockname())
    return bench(MAVLINK, scenario(), address=address, message=message, **own)


def batch(made: Bench, seconds: float, lost: bool, published: bool) -> None:
    fix = Fix(seconds, *PLACE, np.eye(2), None if published else "no", reset=lost)
    message = topics.INFORMATION.type()
    fill_whole_fix(message, from_seconds(seconds), WholeFix(fix))
    made.publish(topics.INFORMATION, message)


def test_gps_input(receiver, scenario) -> None:
    with node(receiver, scenario, GPS_INPUT) as made:
        made.nav(5.0, *PLACE, velocity=(10.0, -4.0))
        (found,) = received(receiver, GPS_INPUT)
    assert found.lat == pytest.approx(-37.9e7, abs=1)
    assert found.lon == pytest.approx(144.6e7, abs=1)
    assert (found.vn, found.ve) == pytest.approx((10.0, -4.0), abs=1e-5)
    assert found.horiz_accuracy == pytest.approx(30.0, rel=1e-6)
    assert found.speed_accuracy == pytest.approx(0.1, rel=1e-6)
    assert found.time_usec == 5_000_000
    assert found.fix_type == 3
    assert found.ignore_flags & common.GPS_INPUT_IGNORE_FLAG_ALT
    assert not found.ignore_flags & common.GPS_INPUT_IGNORE_FLAG_HORIZONTAL_ACCURACY
    assert (found.get_srcSystem(), found.get_srcComponent()) == (1, 197)


def test_vision_position_estimate(receiver, scenario) -> None:
    first = scenario().route.start
    place = math.radians(first[0]) + 1e-4, math.radians(first[1]) + 2e-4
    with node(receiver, scenario, VISION) as made:
        made.nav(5.0, *place)
        (found,) = received(receiver, VISION)
        frame: LocalFrame = map_frame(made.scenario)
    east, north, up = frame.from_geodetic(*place, 100.0)
    assert (found.x, found.y, found.z) == pytest.approx((north, east, -up), rel=1e-6)
    # from the north of the origin: where the vehicle is, north leans by the meridians' convergence
    assert found.yaw == pytest.approx(0.8 - 2e-4 * math.sin(place[0]), abs=1e-6)
    assert max(abs(found.roll), abs(found.pitch)) < 3e-4
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = found.covariance
    assert np.diag(upper) == pytest.approx([900, 900, 0.01, 1e-10, 1e-10, 1e-8], rel=0.01)


def test_it_is_silent_while_the_navigator_has_diverged(receiver, scenario) -> None:
    with node(receiver, scenario, VISION) as made:
        made.nav(1.0, *PLACE)
        assert len(received(receiver, VISION)) == 1
        batch(made, 1.0, lost=True, published=False)
        made.nav(2.0, *PLACE)
        assert not received(receiver, VISION)
        assert made.says()[-1][:2] == (WARN, "silent: the navigator has diverged")
        batch(made, 2.0, lost=False, published=True)
        made.nav(2.5, *PLACE)  # not yet after the fix
        assert not received(receiver, VISION)
        made.nav(2.5, *PLACE)
        (found,) = received(receiver, VISION)
        assert found.reset_counter == 1


def test_another_place_that_is_likelier_silences_it() -> None:
    silence = Silence()
    silence.probability(0.7)
    assert silence.holds
    silence.probability(0.2)
    assert not silence.holds


def test_rate_and_heartbeat(receiver, scenario) -> None:
    with node(receiver, scenario, GPS_INPUT, rate=2.0) as made:
        for k in range(100):
            made.nav(1.0 + 0.05 * k, *PLACE)
        data = received(receiver, GPS_INPUT)
        assert [one.time_usec for one in data] == [1_000_000 + 500_000 * k for k in range(10)]
        made.bus.tick()
        made.node._beat()
        (beat,) = received(receiver, "HEARTBEAT")[-1:]
        assert beat.type == common.MAV_TYPE_ONBOARD_CONTROLLER


@pytest.mark.parametrize(
    ("own", "words"),
    [({"message": "ODOMETRY"}, "must be GPS_INPUT or"), ({"address": "x"}, "host:")],
)
def test_bad_parameters(scenario, own, words) -> None:
    from isogal.errors import InputError

    with pytest.raises(InputError, match=words), bench(MAVLINK, scenario(), **own):
        pass
