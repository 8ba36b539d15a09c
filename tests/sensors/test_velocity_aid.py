"""Simulated velocity aids."""

import numpy as np
import pytest

from helpers.aids import in_turns
from isogal.fusion.measurements import VelocityReading
from isogal.inertial.rotations import matrix
from isogal.scenario import load_scenario
from isogal.sensors.velocity_aid import simulate_velocities

CLEAN = ["velocity.sigma=1e-9", "velocity.scale=0", "velocity.misalignment=0",
         "velocity.current_sigma=0"]  # fmt: skip


def simulated(kind, runs, *more):
    it, trajectory = in_turns(f"velocity.kind={kind}", *more)
    aid = it.true.velocity
    found = simulate_velocities(aid, trajectory, it.seed, range(runs), [aid])
    return found.values, trajectory


def in_body(trajectory):
    to_body = np.swapaxes(matrix(trajectory.attitude[1:]), 1, 2)
    return np.einsum("kij,kj->ki", to_body, trajectory.velocity[1:])


@pytest.mark.parametrize(
    ("kind", "axes"), [("dvl", 3), ("odometer", 3), ("log", 2), ("airspeed", 1)]
)
def test_a_perfect_one_reads_the_velocity_in_body_axes(kind, axes):
    read, trajectory = simulated(kind, 1, *CLEAN)
    np.testing.assert_allclose(read[0, :, :axes], in_body(trajectory)[:, :axes], atol=1e-6)
    assert np.isnan(read[0, :, axes:]).all()


def test_errors_are_as_large_as_told():
    """400 runs: sizes within 15 %, four times the standard deviation of such an estimate."""

    def error(key, size):
        others = [one for one in CLEAN if not one.startswith(f"velocity.{key}=")]
        read, trajectory = simulated("dvl", 400, *others, f"velocity.{key}={size}")
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


def test_a_kind_brings_its_own_errors_which_truth_may_multiply():
    it = load_scenario(None, ["velocity.kind=log", "truth.velocity.current_sigma=3x"])
    assert it.velocity.number("current_sigma") == pytest.approx(0.3)
    assert it.true.velocity.number("current_sigma") == pytest.approx(0.9)
    assert it.velocity.axes == (0, 1)
    assert load_scenario().velocity.axes == ()


def test_one_at_a_lever_arm_has_its_own_velocity_which_the_reading_is_relieved_of():
    """Three metres ahead of the inertial sensors it moves sideways in a turn."""
    read, trajectory = simulated("dvl", 1, *CLEAN, "velocity.lever_arm=[3, -1, 0]")
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
