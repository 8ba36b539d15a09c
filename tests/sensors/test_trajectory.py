"""The true route: where it goes. Its perfect IMU leads the strapdown along it (tests/inertial)."""

import numpy as np
import pytest
from pyproj import Geod

from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.scenario import Imu, Route, Scenario
from isogal.sensors.trajectory import _Guide, build_trajectory

CORNERS = ((-38.0, 144.5, 22.0), (-37.9, 144.9, 40.0), (-38.0, 145.1, 15.0), (-37.8, 145.2, 22.0))


def route(rate=1.0, **keys):
    return build_trajectory(
        Scenario(route=Route(**({"duration": None} | keys)), imu=Imu(rate=rate))
    )


def headings(trajectory):
    return np.arctan2(trajectory.velocity[:, 1], trajectory.velocity[:, 0])


def distance(trajectory, place):
    """(N + 1,) m from a place, latitude and longitude in deg."""
    away = horizontal_difference(trajectory.latitude, trajectory.longitude, *np.radians(place))
    return np.hypot(*away.T)


def test_default_route_is_that_of_the_paper():
    trajectory = route(height=0.0)
    speed = np.linalg.norm(trajectory.velocity, axis=1)
    # 594.5 km, 7.5 h (docs/mathematics.md, section 3.8)
    assert trajectory.time[-1] == pytest.approx(7.5 * 3600.0, rel=1e-3)
    assert (speed * trajectory.dt)[1:].sum() == pytest.approx(594.5e3, rel=1e-3)
    np.testing.assert_allclose(speed, 22.0, rtol=1e-14)
    assert np.ptp(headings(trajectory)) == 0.0
    assert distance(trajectory, (-35.0, 150.0))[-1] < 22.0


def test_a_route_over_a_pole_is_refused():
    """It went on to latitudes above 90 deg."""
    over = {"start": (89.9, 0.0), "end": (89.0, 180.0), "line": "geodesic", "speed": 100.0}
    with pytest.raises(InputError, match=r"passes a pole after \d+ s, must stay within 89.95 deg"):
        route(**over)
    beside = route(start=(89.9, 0.0), end=(89.9, 60.0), line="geodesic", speed=100.0)
    assert np.degrees(beside.latitude.max()) == pytest.approx(89.913, abs=2e-3)


def test_geodesic_is_the_shortest_line():
    trajectory = route(line="geodesic", height=0.0)
    line = Geod(ellps="GRS80").inv(144.5, -38.0, 150.0, -35.0)
    azimuth, _, distance = Geod(ellps="GRS80").inv(
        np.full(len(trajectory), 144.5), np.full(len(trajectory), -38.0),
        np.degrees(trajectory.longitude[1:]), np.degrees(trajectory.latitude[1:]),
    )  # fmt: skip
    off = np.array(distance) * np.sin(np.radians(np.array(azimuth) - line[0]))
    assert np.abs(off).max() < 0.05
    np.testing.assert_allclose(distance, 22.0 * trajectory.time[1:], atol=1e-3)


def test_waypoints_are_passed_at_their_speed_within_the_limits():
    trajectory = route(waypoints=CORNERS, turn_rate=0.01, acceleration=0.05)
    turn = np.diff(np.unwrap(headings(trajectory)))
    assert np.abs(turn).max() <= 0.01 + 1e-12
    speed = np.linalg.norm(trajectory.velocity, axis=1)
    assert np.abs(np.diff(speed)).max() <= 0.05 + 1e-12
    for *place, _ in CORNERS:
        assert distance(trajectory, place).min() < 40.0 / 0.01  # a turn's radius at most
    for _, _, wanted in CORNERS[1:]:
        assert np.isclose(speed, wanted, atol=1e-9).any()


CLOSE = ((-38.0, 144.5, 22.0), (-37.9, 144.6, 22.0), (-37.9, 144.603, 22.0))


@pytest.mark.parametrize(
    ("points", "turn_rate"), [(CLOSE, 0.02), ((*CLOSE[:2], (-37.95, 144.65, 22.0)), 0.001)]
)
def test_a_point_inside_the_turning_circle_is_reached(points, turn_rate):
    trajectory = route(waypoints=points, turn_rate=turn_rate)
    assert distance(trajectory, points[-1][:2])[-1] < 22.0
    assert np.abs(np.diff(np.unwrap(headings(trajectory)))).max() <= turn_rate + 1e-12


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"duration": 1e5}, r"route\.duration: the route ends after 27\d\d\d s, duration asks"),
        ({"duration": 1.0}, "route: must last at least two IMU samples"),
        ({"waypoints": CORNERS}, r"route\.waypoints: point 2 is never reached with turn_rate"),
    ],
)
def test_routes_that_cannot_be_driven(monkeypatch, keys, message):
    """The last by a vehicle that turns for ever."""
    if "waypoints" in keys:
        monkeypatch.setattr(_Guide, "command", lambda self, *_: (self.turn_limit, 0.0))
    with pytest.raises(InputError, match=message):
        route(**keys)
