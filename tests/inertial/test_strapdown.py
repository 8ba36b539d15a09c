"""The strapdown: no drift without noise, the Schuler oscillation, the unstable vertical channel,
known height, run axis."""

import numpy as np
import pytest

from isogal.earth.ellipsoid import EARTH_RATE, radii
from isogal.earth.frames import horizontal_difference
from isogal.earth.gravity import normal_gravity
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_heading
from isogal.inertial.strapdown import propagate
from isogal.scenario import Imu, Route, Scenario
from isogal.sensors.trajectory import build_trajectory

CORNERS = (
    (-38.0, 144.5, 22.0),
    (-37.0, 146.0, 60.0),
    (-37.3, 147.0, 30.0),
    (-36.2, 147.1, 22.0),
    (-35.0, 150.0, 22.0),
)
SCHULER = 84.4 * 60.0
"""s, the period of a pendulum of the Earth's radius (Titterton & Weston 2004, section 3.7.1;
Groves 2013, section 5.7.2)."""


NORTH = {"start": (67.0, 179.0), "end": (68.0, -178.0), "speed": 250.0, "height": 9000.0}


@pytest.mark.parametrize(
    ("route", "rate", "metres"),
    [
        ({}, 1.0, 1e-3),
        ({"line": "geodesic"}, 1.0, 1e-3),
        ({"waypoints": CORNERS}, 1.0, 1.0),
        ({"waypoints": CORNERS[:3]}, 4.0, 0.05),
        (NORTH, 1.0, 0.02),
    ],
    ids=["rhumb", "geodesic", "corners", "corners at 4 Hz", "fast, high, across the date line"],
)
def test_without_noise_it_stays_on_the_route(route, rate, metres):
    truth = build_trajectory(Scenario(route=Route(duration=None, **route), imu=Imu(rate=rate)))
    start = Estimate(
        np.array([[truth.latitude[0], truth.longitude[0], truth.height[0]]]),
        truth.velocity[:1].copy(),
        truth.attitude[:1].copy(),
    )
    samples = truth.specific_force[None], truth.angular_rate[None]
    end, track = propagate(start, *samples, truth.dt, truth.height, history=True)
    drift = horizontal_difference(*track[0, :, :2].T, truth.latitude[1:], truth.longitude[1:])
    assert np.hypot(*drift.T).max() < metres
    schuler_rate = 1.0 / 800.0
    np.testing.assert_allclose(end.velocity[0], truth.velocity[-1], atol=metres * schuler_rate)
    assert abs(end.attitude[0] @ truth.attitude[-1]) > 1.0 - 1e-12


def standing(latitude: float, seconds: int) -> tuple[Estimate, np.ndarray, np.ndarray]:
    """A vehicle at rest, its nose to the north, and what it senses."""
    rate = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    force = np.array([0.0, 0.0, -float(normal_gravity(latitude))])
    nav = Estimate(np.array([[latitude, 2.0, 0.0]]), np.zeros((1, 3)), from_heading(np.zeros(1)))
    return nav, np.tile(force, (1, seconds, 1)), np.tile(rate, (1, seconds, 1))


def test_schuler_oscillation_from_a_velocity_error():
    nav, *senses = standing(0.0, 6000)
    nav.velocity[0, 1] = 0.1
    _, track = propagate(nav, *senses, 1.0, np.zeros(6001), history=True)
    error = horizontal_difference(*track[0, :, :2].T, *nav.position[0, :2])[:, 1]
    crossings = np.flatnonzero(np.diff(np.sign(error)))
    period = 2.0 * (crossings[0] + 1.5)  # the pendulum is back at its start after half a period
    assert period == pytest.approx(SCHULER, rel=5e-3)
    _, normal = radii(0.0)
    exact = 2.0 * np.pi * np.sqrt(normal / normal_gravity(0.0))  # that of the equator's radius
    assert period == pytest.approx(exact, abs=2.0)
    assert error.max() == pytest.approx(0.1 * exact / (2.0 * np.pi), rel=1e-3)


def test_free_height_is_unstable_with_the_published_time_constant():
    nav, *senses = standing(np.radians(-36.5), 600)
    nav.position[0, 2] = 1.0
    for seconds in (600.0, 1200.0, 1800.0):
        nav, _ = propagate(nav, *senses, 1.0)
        # h'' = 2 g h / R from rest: cosh(t / 570 s) (Titterton & Weston 2004, section 12.4)
        assert nav.position[0, 2] == pytest.approx(np.cosh(seconds / 570.0), rel=0.03)


def test_known_height_is_followed():
    end, _ = propagate(*standing(0.5, 10), 1.0, np.linspace(0.0, 20.0, 11))
    assert end.position[0, 2] == 20.0
    assert end.velocity[0, 2] == pytest.approx(-2.0)


def test_start_is_unchanged_and_runs_are_independent():
    random = np.random.default_rng(2)
    runs = 5
    nav = Estimate(
        np.column_stack([random.uniform(-1.0, 1.0, (runs, 2)), random.uniform(0.0, 1e3, runs)]),
        random.normal(0.0, 20.0, (runs, 3)),
        from_heading(random.uniform(0.0, 6.0, runs)),
    )
    before = Estimate(*(part.copy() for part in nav))
    force, rate = random.normal(0.0, 10.0, (runs, 50, 3)), random.normal(0.0, 0.1, (runs, 50, 3))
    end, track = propagate(nav, force, rate, 0.5, history=True)
    np.testing.assert_array_equal(np.hstack(nav), np.hstack(before))
    for r in range(runs):
        one = slice(r, r + 1)
        alone, alone_track = propagate(
            Estimate(*(part[one] for part in nav)), force[one], rate[one], 0.5, history=True
        )
        np.testing.assert_array_equal(np.hstack(alone)[0], np.hstack(end)[r])
        np.testing.assert_array_equal(alone_track[0], track[r])
    np.testing.assert_allclose(np.linalg.norm(end.attitude, axis=1), 1.0, atol=1e-15)
    assert propagate(nav, force, rate, 0.5)[1].shape == (runs, 0, 10)
