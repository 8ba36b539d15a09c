"""Simulated aids: satellites, sensors of position, heading, velocity and height."""

import math

import numpy as np
import pytest

from helpers.aids import displacement, in_turns
from helpers.refusals import refusal
from isogal.earth.frames import LocalFrame
from isogal.fusion.measurements import VelocityReading
from isogal.inertial.rotations import matrix
from isogal.scenario import Height, load_scenario
from isogal.sensors.barometer import (
    height_of,
    height_slope,
    pressure_of,
    simulate_heights,
    standard_pressure,
)
from isogal.sensors.heading_aid import simulate_headings
from isogal.sensors.position_aid import simulate_positions
from isogal.sensors.satellites import simulate_satellites
from isogal.sensors.trajectory import build_trajectory
from isogal.sensors.velocity_aid import simulate_velocities

EXACT = "gnss.position_sigma=1e-9", "gnss.velocity_sigma=1e-9", "gnss.correlated_sigma=0"


def satellites(runs, *more):
    it, trajectory = in_turns("gnss.available=[[0, 600]]", *more)
    return *simulate_satellites(it.true.gnss, trajectory, it.seed, range(runs)), trajectory


def test_perfect_satellites_give_place_and_velocity_of_their_antenna():
    arm = np.array([3.0, -1.0, -2.0])
    fixes, velocities, trajectory = satellites(1, *EXACT, "gnss.lever_arm=[3, -1, -2]")
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


def test_errors_of_satellites_are_as_large_as_told():
    """400 runs: sizes within 5 %, more than four times the standard deviation of such an
    estimate."""
    fixes, velocities, trajectory = satellites(400, "gnss.interval=30")
    error = displacement(fixes, trajectory)
    sigma = np.hypot(1.0, 1.5)
    assert error.std(axis=0).mean(axis=0) == pytest.approx([sigma, sigma, 1.5 * sigma], rel=0.05)
    # 300 s apart what changes slowly keeps exp(-1/2), what is white nothing
    kept = np.mean(error[:, 10:, :2] * error[:, :-10, :2]) / 1.5**2
    assert kept == pytest.approx(np.exp(-0.5), abs=0.1)
    noise = (velocities.values - trajectory.velocity[fixes.ends]).std(axis=0).mean(axis=0)
    assert noise == pytest.approx([0.03, 0.03, 0.045], rel=0.05)


def test_without_satellites_there_is_nothing():
    fixes, velocities, trajectory = satellites(1, "gnss.available=[[0, 100], [300, 400.5]]")
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
def test_a_deceived_receiver_is_where_it_was_told(deception, away, speed):
    keys = [f"gnss.deception.{one}" for one in (*deception, "start=200", "end=500")]
    fixes, velocities, trajectory = satellites(2, *EXACT, *keys)
    since = trajectory.time[fixes.ends] - 200.0
    during = (since >= 0.0) & (since <= 300.0)
    off = np.hypot(*np.moveaxis(displacement(fixes, trajectory)[..., :2], -1, 0))
    np.testing.assert_allclose(off[:, during], [away(since[during])] * 2, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(off[:, ~during], 0.0, atol=1e-6)
    extra = velocities.values - trajectory.velocity[fixes.ends]
    size = np.hypot(extra[..., 0], extra[..., 1])
    np.testing.assert_allclose(size[:, during], speed, atol=1e-6)


def test_a_delayed_receiver_is_where_the_vehicle_was():
    keys = "gnss.deception.kind=delay", "gnss.deception.size=4", "gnss.deception.start=100"
    fixes, _, trajectory = satellites(1, *EXACT, *keys)
    late = trajectory.time[fixes.ends] >= 100.0
    before = fixes.ends[late] - 4
    was = np.stack([trajectory.latitude[before], trajectory.longitude[before]], axis=1)
    np.testing.assert_allclose(fixes.values[0, late, :2], was, atol=1e-12)


def test_a_position_is_that_of_its_arm_with_errors_as_large_as_told():
    """400 runs, sizes within 5 %: more than four standard deviations of such an estimate."""
    entry = "{sigma: 8, correlated_sigma: 6, lever_arm: [3, -1, 40]}"
    it, trajectory = in_turns(f"positions=[{entry}]")
    fixes = simulate_positions(it.true.positions[0], trajectory, it.seed, range(400))
    arm = matrix(trajectory.attitude[fixes.ends]) @ [3.0, -1.0, 40.0]
    error = displacement(fixes, trajectory) - arm
    np.testing.assert_allclose(error.std(axis=0).mean(axis=0), 10.0, rtol=0.05)
    np.testing.assert_allclose(error.mean(axis=(0, 1)), 0.0, atol=1.0)


@pytest.mark.parametrize("kind", ["antennas", "compass", "course"])
def test_a_heading_is_that_of_the_bow(kind):
    exact = "sigma: 1e-9, bias: 0, correlated_sigma: 0"
    it, trajectory = in_turns(f"headings=[{{kind: {kind}, {exact}}}]")
    aid, epoch = it.true.headings[0], it.magnetometer.epoch
    seen = simulate_headings(aid, trajectory, it.seed, [0], epoch)
    true = np.arctan2(*matrix(trajectory.attitude[seen.ends])[:, [1, 0], 0].T)
    # the declination near Melbourne is 11.9 degrees east (IGRF, 2025)
    east = math.radians(11.9) if kind == "compass" else 0.0
    off = np.remainder(seen.values[0] + east - true + math.pi, 2.0 * math.pi) - math.pi
    np.testing.assert_allclose(off, 0.0, atol=5e-3 if east else 1e-6)


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ("positions=[{}, {}]", "two entries of one name"),
        ("velocities=[{name: a}]", "velocities.0.kind: must be a sensor"),
        ("heights=[{name: a}]", "heights.0: it and height must have a sensor"),
        ("positions=[{name: A b}]", "name"),
        ("positions=[{interval: 0.3}]", "positions.0.interval"),
        ("positions=[{truth: {interval: 5}}]", "cannot differ"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(bad, says):
    with refusal(says):
        load_scenario(None, [bad])


CLEAN = ["velocity.sigma=1e-9", "velocity.scale=0", "velocity.misalignment=0",
         "velocity.current_sigma=0"]  # fmt: skip


def velocities(kind, runs, *more):
    it, trajectory = in_turns(f"velocity.kind={kind}", *more)
    aid = it.true.velocity
    found = simulate_velocities(aid, trajectory, it.seed, range(runs), [aid])
    return found.values, trajectory


def in_body(trajectory):
    to_body = np.swapaxes(matrix(trajectory.attitude[1:]), 1, 2)
    return np.einsum("kij,kj->ki", to_body, trajectory.velocity[1:])


@pytest.mark.parametrize(("kind", "axes"), [("dvl", 3), ("log", 2), ("airspeed", 1)])
def test_a_perfect_velocity_aid_reads_the_velocity_in_body_axes(kind, axes):
    read, trajectory = velocities(kind, 1, *CLEAN)
    np.testing.assert_allclose(read[0, :, :axes], in_body(trajectory)[:, :axes], atol=1e-6)
    assert np.isnan(read[0, :, axes:]).all()


def test_errors_of_velocities_are_as_large_as_told():
    """400 runs: sizes within 15 %, four times the standard deviation of such an estimate."""

    def error(key, size):
        others = [one for one in CLEAN if not one.startswith(f"velocity.{key}=")]
        read, trajectory = velocities("dvl", 400, *others, f"velocity.{key}={size}")
        body = in_body(trajectory)[100]
        return read[:, 100] - body, pytest.approx(size * body[0], rel=0.15)

    scale, expected = error("scale", 0.01)
    assert scale[:, 0].std() == expected
    mounting, expected = error("misalignment", 0.01)
    assert mounting[:, 1].std() == expected
    assert mounting[:, 2].std() == expected
    current, _ = error("current_sigma", 0.4)
    assert np.hypot(current[:, 0], current[:, 1]).std() < 0.4
    assert np.sqrt(np.mean(current[:, :2] ** 2)) == pytest.approx(0.4, rel=0.15)
    white, _ = error("sigma", 0.05)
    assert white.std() == pytest.approx(0.05, rel=0.15)


def test_a_velocity_at_a_lever_arm_is_relieved_of_what_turns_do_there():
    """Three metres ahead of the inertial sensors it moves sideways in a turn."""
    read, trajectory = velocities("dvl", 1, *CLEAN, "velocity.lever_arm=[3, -1, 0]")
    rate = trajectory.angular_rate
    change = np.abs(np.diff(rate[:, 2], append=rate[-1, 2]))
    steady = change < 1e-6
    around = np.cross(rate, [3.0, -1.0, 0.0])
    assert np.abs(around).max() > 0.04
    plain = in_body(trajectory)
    np.testing.assert_allclose(read[0][steady], (plain + around)[steady], atol=1e-5)
    settings = load_scenario(None, ["velocity.kind=dvl", "velocity.lever_arm=[3, -1, 0]"]).velocity
    k = int(np.argmax(np.where(steady, np.abs(rate[:, 2]), 0.0)))
    found = VelocityReading.of(settings, read[0, k], rate=rate[k])
    np.testing.assert_allclose(found.velocity, plain[k], atol=1e-5)


STANDARD = {0.0: 101325.0, 1000.0: 89876.0, 10000.0: 26500.0, 20000.0: 5529.3, 40000.0: 287.14}
"""Pa by geometric height, m: US Standard Atmosphere, 1976, table I."""


def test_the_standard_atmosphere_is_the_published_one():
    height, pressure = np.array(list(STANDARD)), np.array(list(STANDARD.values()))
    np.testing.assert_allclose(standard_pressure(height), pressure, rtol=6e-5)
    sea = Height(source="depth")  # ten metres of its water are an atmosphere
    assert pressure_of(-10.0, sea) == pytest.approx(101325.0 + 100518.0, abs=1.0)


@pytest.mark.parametrize("settings", [Height(source="barometer"), Height(source="depth")])
def test_height_and_pressure_are_each_others_inverse(settings):
    height = np.linspace(-400.0, 45000.0 if settings.source == "barometer" else 5.0, 60)
    pressure = pressure_of(height, settings)
    np.testing.assert_allclose(height_of(pressure, settings), height, atol=1e-6)
    step = 1e-3
    slope = np.diff(height_of([pressure[3], pressure[3] + step], settings))[0] / step
    assert height_slope(float(pressure[3]), settings) == pytest.approx(slope, rel=1e-4)


def heights(runs, *more):
    """Ends of the intervals of readings, and their errors (R, N), m."""
    keys = "route.duration=300", "route.height=1000", "gravity.field=normal"
    it = load_scenario(None, [*keys, "height.source=barometer", *more])
    read = simulate_heights(it.true.height, build_trajectory(it), it.seed, range(runs))
    return read.ends, read.values - 1000.0


def test_errors_of_heights_are_as_large_as_told():
    """400 runs: sizes within 15 % (four times the standard deviation of such an estimate)."""
    none = {"sigma": 1e-6, "weather_sigma": 0.0, "bias": 0.0, "scale": 0.0}

    def errors(runs, duration=10, **told):
        keys = [f"height.{key}={value}" for key, value in (none | told).items()]
        return heights(runs, f"route.duration={duration}", *keys)[1]

    assert errors(400, bias=8.0)[:, 5].std() == pytest.approx(8.0, rel=0.15)
    assert errors(400, scale=0.02)[:, 5].std() == pytest.approx(20.0, rel=0.15)
    assert errors(20, 300, sigma=0.7).std() == pytest.approx(0.7, rel=0.03)
    weather = errors(400, 300, weather_sigma=10.0, weather_time=60.0)
    assert weather[:, -1].std() == pytest.approx(10.0, rel=0.15)
    together = np.mean(weather[:, -1] * weather[:, -61]) / 100.0
    assert together == pytest.approx(np.exp(-1.0), abs=0.2)


def test_heights_come_at_their_interval_and_do_not_depend_on_other_runs():
    ends, rare = heights(3, "height.interval=20")
    assert ends.tolist() == list(range(20, 301, 20))
    np.testing.assert_array_equal(heights(2, "height.interval=20")[1], rare[:2])
    with refusal("height.interval (0.7 s) must be a whole number"):
        load_scenario(None, ["height.source=barometer", "height.interval=0.7"])
    load_scenario(None, ["height.interval=0.7"])  # nobody reads it
