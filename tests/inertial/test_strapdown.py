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
from isogal.sensors.trajectory import Trajectory, build_trajectory

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


def start_of(trajectory: Trajectory) -> Estimate:
    position = np.array([[trajectory.latitude[0], trajectory.longitude[0], trajectory.height[0]]])
    return Estimate(position, trajectory.velocity[:1].copy(), trajectory.attitude[:1].copy())


@pytest.mark.parametrize(
    ("route", "rate", "metres"),
    [
        (Route(duration=None), 1.0, 1e-3),
        (Route(duration=None, line="geodesic"), 1.0, 1e-3),
        (Route(duration=None, waypoints=CORNERS), 1.0, 1.0),
        (Route(duration=None, waypoints=CORNERS[:3]), 4.0, 0.05),
        (
            Route(
                start=(67.0, 179.0), end=(68.0, -178.0), speed=250.0, height=9000.0, duration=None
            ),
            1.0,
            0.02,
        ),
    ],
    ids=["rhumb", "geodesic", "corners", "corners at 4 Hz", "fast, high, across the date line"],
)
def test_without_noise_it_stays_on_the_route(route, rate, metres):
    trajectory = build_trajectory(Scenario(route=route, imu=Imu(rate=rate)))
    end, track = propagate(
        start_of(trajectory),
        trajectory.specific_force[None],
        trajectory.angular_rate[None],
        trajectory.dt,
        trajectory.height,
        history=True,
    )
    drift = horizontal_difference(*track[0].T, trajectory.latitude[1:], trajectory.longitude[1:])
    assert np.hypot(*drift.T).max() < metres
    np.testing.assert_allclose(
        end.velocity[0], trajectory.velocity[-1], atol=metres / 800.0
    )  # the Schuler rate
    assert abs(end.attitude[0] @ trajectory.attitude[-1]) > 1.0 - 1e-12


def standing(latitude: float, seconds: int) -> tuple[Estimate, np.ndarray, np.ndarray, np.ndarray]:
    """A vehicle at rest, its nose to the north, and what it senses."""
    rate = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    force = np.array([0.0, 0.0, -float(normal_gravity(latitude))])
    nav = Estimate(np.array([[latitude, 2.0, 0.0]]), np.zeros((1, 3)), from_heading(np.zeros(1)))
    return (
        nav,
        np.tile(force, (1, seconds, 1)),
        np.tile(rate, (1, seconds, 1)),
        np.zeros(seconds + 1),
    )


def east_error(
    nav: Estimate, force: np.ndarray, rate: np.ndarray, height: np.ndarray
) -> np.ndarray:
    _, track = propagate(nav, force, rate, 1.0, height, history=True)
    return horizontal_difference(
        track[0, :, 0], track[0, :, 1], nav.position[0, 0], nav.position[0, 1]
    )[:, 1]


def test_schuler_oscillation_from_a_velocity_error():
    nav, *senses = standing(0.0, 6000)
    nav.velocity[0, 1] = 0.1
    error = east_error(nav, *senses)
    crossings = np.flatnonzero(np.diff(np.sign(error)))
    period = 2.0 * (crossings[0] + 1.5)  # the pendulum is back at its start after half a period
    assert period == pytest.approx(SCHULER, rel=5e-3)
    _, normal = radii(0.0)
    exact = 2.0 * np.pi * np.sqrt(normal / normal_gravity(0.0))  # that of the equator's radius
    assert period == pytest.approx(exact, abs=2.0)
    assert error.max() == pytest.approx(0.1 * exact / (2.0 * np.pi), rel=1e-3)


def test_free_height_is_unstable_with_the_published_time_constant():
    nav, force, rate, _ = standing(np.radians(-36.5), 1800)
    nav.position[0, 2] = 1.0
    heights = []
    for _ in range(3):
        nav, _ = propagate(nav, force[:, :600], rate[:, :600], 1.0)
        heights.append(nav.position[0, 2])
    # h'' = 2 g h / R from rest: cosh(t / 570 s) (Titterton & Weston 2004, section 12.4)
    np.testing.assert_allclose(
        heights, np.cosh(np.array([600.0, 1200.0, 1800.0]) / 570.0), rtol=0.03
    )


def test_known_height_is_followed():
    nav, force, rate, height = standing(0.5, 10)
    height = height + np.linspace(0.0, 20.0, 11)
    end, _ = propagate(nav, force, rate, 1.0, height)
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
    for r in range(runs):
        one = Estimate(nav.position[r : r + 1], nav.velocity[r : r + 1], nav.attitude[r : r + 1])
        alone, alone_track = propagate(one, force[r : r + 1], rate[r : r + 1], 0.5, history=True)
        for name in ("position", "velocity", "attitude"):
            assert (getattr(alone, name)[0] == getattr(end, name)[r]).all()
            assert (getattr(nav, name) == getattr(before, name)).all()
        assert (alone_track[0] == track[r]).all()
    np.testing.assert_allclose(np.linalg.norm(end.attitude, axis=1), 1.0, atol=1e-15)
    assert propagate(nav, force, rate, 0.5)[1].shape == (runs, 0, 2)
