"""The strapdown: no drift without noise, known height, run axis. Each step equals a reference
(tests/fusion/test_prediction.py)."""

import numpy as np
import pytest

from isogal.earth.frames import horizontal_difference
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
