"""The simulated satellite receiver."""

import numpy as np
import pytest

from helpers.aids import displacement, in_turns
from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import matrix
from isogal.sensors.satellites import simulate_satellites

CLEAN = "gnss.position_sigma=1e-9", "gnss.velocity_sigma=1e-9", "gnss.correlated_sigma=0"


def simulated(runs, *more):
    it, trajectory = in_turns("gnss.available=[[0, 600]]", *more)
    return *simulate_satellites(it.true.gnss, trajectory, it.seed, range(runs)), trajectory


def test_a_perfect_one_gives_place_and_velocity_of_its_antenna():
    arm = np.array([3.0, -1.0, -2.0])
    fixes, velocities, trajectory = simulated(1, *CLEAN, "gnss.lever_arm=[3, -1, -2]")
    to_ned = matrix(trajectory.attitude[fixes.ends])
    # a metre of arm and the height of 100 m: the radii change by 1e-5
    np.testing.assert_allclose(displacement(fixes, trajectory)[0], to_ned @ arm, atol=1e-4)
    # differences of the antenna's places over two steps are its velocity between them
    frame = LocalFrame(*fixes.values[0, 0])
    place = frame.from_geodetic(*fixes.values[0].T)
    moving = (place[2:] - place[:-2])[:, [1, 0]] / 2.0
    speed = velocities.values[0, 1:-1, :2]
    change = np.abs(np.diff(trajectory.angular_rate[:, 2], prepend=0.0))
    steady = (change[2:] < 1e-4) & (change[1:-1] < 1e-4)
    assert steady.sum() > 500
    np.testing.assert_allclose(speed[steady], moving[steady], atol=0.05)


def test_errors_are_as_large_as_told():
    """400 runs: sizes within 15 %, four times the standard deviation of such an estimate."""
    fixes, velocities, trajectory = simulated(400, "gnss.interval=30")
    error = displacement(fixes, trajectory)
    sigma = np.hypot(1.0, 1.5)
    assert error.std(axis=0).mean(axis=0) == pytest.approx([sigma, sigma, 1.5 * sigma], rel=0.05)
    # 300 s apart what changes slowly keeps exp(-1/2), what is white nothing
    kept = np.mean(error[:, 10:, :2] * error[:, :-10, :2]) / 1.5**2
    assert kept == pytest.approx(np.exp(-0.5), abs=0.1)
    noise = (velocities.values - trajectory.velocity[fixes.ends]).std(axis=0).mean(axis=0)
    assert noise == pytest.approx([0.03, 0.03, 0.045], rel=0.05)


def test_without_satellites_there_is_nothing():
    fixes, velocities, trajectory = simulated(1, "gnss.available=[[0, 100], [300, 400.5]]")
    time = trajectory.time[fixes.ends]
    seen = np.isfinite(fixes.values[0]).all(axis=1)
    np.testing.assert_array_equal(seen, (time <= 100.0) | ((time >= 300.0) & (time <= 400.5)))
    np.testing.assert_array_equal(seen, np.isfinite(velocities.values[0]).all(axis=1))


@pytest.mark.parametrize(
    ("deception", "away", "speed"),
    [
        (("kind=jump", "size=80"), lambda t: np.full_like(t, 80.0), 0.0),
        (("kind=walk", "rate=0.5"), lambda t: 0.5 * t, 0.5),
    ],
)
def test_a_deceived_one_is_where_it_was_told(deception, away, speed):
    keys = [f"gnss.deception.{one}" for one in (*deception, "start=200", "end=500")]
    fixes, velocities, trajectory = simulated(2, *CLEAN, *keys)
    since = trajectory.time[fixes.ends] - 200.0
    during = (since >= 0.0) & (since <= 300.0)
    off = np.hypot(*np.moveaxis(displacement(fixes, trajectory)[..., :2], -1, 0))
    np.testing.assert_allclose(off[:, during], [away(since[during])] * 2, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(off[:, ~during], 0.0, atol=1e-6)
    extra = velocities.values - trajectory.velocity[fixes.ends]
    size = np.hypot(extra[..., 0], extra[..., 1])
    np.testing.assert_allclose(size[:, during], speed, atol=1e-6)


def test_a_delayed_one_is_where_the_vehicle_was():
    keys = "gnss.deception.kind=delay", "gnss.deception.size=4", "gnss.deception.start=100"
    fixes, _, trajectory = simulated(1, *CLEAN, *keys)
    late = trajectory.time[fixes.ends] >= 100.0
    before = fixes.ends[late] - 4
    np.testing.assert_allclose(
        fixes.values[0, late, :2],
        np.stack([trajectory.latitude[before], trajectory.longitude[before]], axis=1),
        atol=1e-12,
    )
