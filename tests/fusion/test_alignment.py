"""Alignment at rest and on the move: time and error against the gyroscopes' limit, honest
covariance, and what is said before."""

import math

import numpy as np
import pytest

from isogal.fusion.alignment import POOR_AIM, UNKNOWN, Alignment
from isogal.fusion.assumed import filter_model
from isogal.fusion.coarse import HEADINGS, between_directions, triad
from isogal.fusion.measurements import (
    GroundVelocity,
    HeadingReading,
    PositionFix,
    VelocityReading,
)
from isogal.fusion.measurements.rest import sensed_at_rest
from isogal.fusion.standstill import Standstill
from isogal.inertial.rotations import from_angles, matrix, multiply, to_rotation_vector
from isogal.scenario import Scenario
from isogal.sensors.imu import simulate_samples
from isogal.sensors.trajectory import Trajectory, build_trajectory

PHONE = {
    "grade": "tactical",
    "accelerometer": {"bias": 0.2, "random_walk": 0.01},
    "gyroscope": {"bias": "0.3deg/s", "random_walk": 5e-4},
}
TURNS = [[45.0, 10.0, 12.0], [45.004, 10.0, 20.0], [45.004, 10.006, 12.0], [45.01, 10.006, 15.0],
         [45.01, 10.03, 12.0]]  # fmt: skip


def scenario(imu, **route) -> Scenario:
    route = {"waypoints": TURNS, "turn_rate": 0.05, "acceleration": 0.5} | route
    return Scenario.model_validate(
        {"imu": imu, "route": route, "gravity": {"field": "normal"}, "seed": 3}
    )


def error_of(it: Alignment, truth: np.ndarray) -> np.ndarray:
    w, x, y, z = truth
    return np.array(to_rotation_vector(*multiply(*it.state.attitude, w, -x, -y, -z)))


def start_of(trajectory: Trajectory) -> np.ndarray:
    return np.array([trajectory.latitude[0], trajectory.longitude[0], trajectory.height[0]])


def felt(scenario: Scenario, run: int) -> tuple[Trajectory, np.ndarray]:
    """The trajectory, and the samples (K, 6) of its sensors."""
    trajectory = build_trajectory(scenario)
    return trajectory, simulate_samples(scenario.true, trajectory, run)


def take(it: Alignment, trajectory: Trajectory, samples: np.ndarray, rows=slice(None)) -> None:
    """Some samples of a trajectory, from where the alignment stands."""
    stamps = trajectory.time[1:][rows]
    it.imu(stamps, samples[rows, :3], samples[rows, 3:], trajectory.height[1:][rows])


def rested(grade: str, seconds: int, run: int = 0, tilt=(0.02, -0.03)) -> tuple[Alignment, ...]:
    """An alignment after some time at rest with a tilt, and the true attitude."""
    it = scenario({"grade": grade}, at_rest=float(seconds), duration=float(seconds))
    model, (trajectory, samples) = filter_model(it), felt(it, run)
    truth = from_angles(*tilt, 2.5)
    sensed = np.reshape(sensed_at_rest(start_of(trajectory), model), (2, 3))
    # the sensors' errors are those of a level vehicle with another heading
    samples = samples + np.ravel(sensed @ (matrix(truth) - matrix(trajectory.attitude[0])))
    alignment = Alignment(model, start_of(trajectory))
    take(alignment, trajectory, samples)
    return alignment, truth


def test_directions_give_an_attitude() -> None:
    truth = matrix(from_angles(0.4, -0.9, -2.0))
    a, b = np.array([0.1, 0.2, -9.8]), np.array([5e-5, 0.0, -4e-5])
    np.testing.assert_allclose(
        matrix(triad((truth.T @ a, a), (truth.T @ b, b))), truth, atol=1e-12
    )
    for body in (truth.T @ a, -a, a):
        turned = matrix(between_directions(body, a)) @ body
        np.testing.assert_allclose(turned, a, atol=1e-5)
    for nothing in (np.zeros(3), 1e-6 * a):
        level = matrix(triad((a, a), (nothing, b)))
        np.testing.assert_allclose(level @ a, a, atol=1e-12)


def test_at_rest_to_a_milliradian() -> None:
    it, truth = rested("navigation", 240)
    assert it.aligned
    assert not it.over  # it is still at rest
    assert it.heading_sigma < 1e-3
    error = error_of(it, truth)
    assert abs(error[2]) < 4.0 * it.heading_sigma
    assert np.abs(error[:2]).max() < 4.0 * math.sqrt(it.state.covariance[6, 6])


def test_honest_at_rest() -> None:
    """The mean of 24 chi-squares of three degrees of freedom is within 0.47 and 1.79 in all but
    one of 10,000 times."""
    runs = [rested("tactical", 90, run) for run in range(24)]
    nees = []
    for it, truth in runs:
        error, P = error_of(it, truth), it.state.covariance[6:9, 6:9]
        nees.append(error @ np.linalg.solve(P, error) / 3.0)
    assert 0.47 < np.mean(nees) < 1.79
    # the filter has not taken the gyroscopes' bias for the heading
    assert min(it.heading_sigma for it, _ in runs) > 0.95 * runs[0][0].north


def test_sensors_that_cannot_find_north_say_so_and_take_a_heading() -> None:
    imu = scenario(PHONE, at_rest=80.0, duration=80.0)
    trajectory, samples = felt(imu, 0)
    it = Alignment(filter_model(imu), start_of(trajectory))
    take(it, trajectory, samples)
    assert it.poor and not it.aligned
    assert it.aim == POOR_AIM
    assert it.heading_sigma == pytest.approx(UNKNOWN, rel=0.05)
    assert "waits for a course, a heading or a pose" in it.progress[1]
    it.measure(80.0, HeadingReading(0.05, 0.03**2))
    assert it.aligned
    assert abs(error_of(it, trajectory.attitude[-1])[2]) < 4.0 * it.heading_sigma < 0.2
    # a heading that was told is not forgotten at rest
    it.imu(trajectory.time[1:] + 80.0, samples[:, :3], samples[:, 3:], trajectory.height[1:])
    assert abs(error_of(it, trajectory.attitude[-1])[2]) < 4.0 * it.heading_sigma < 0.2


@pytest.mark.parametrize(
    ("imu", "course"),
    [({"grade": "navigation"}, True), (PHONE, True), (PHONE, False)],
    ids=["navigation", "phone", "phone without a course"],
)
def test_on_the_move_with_satellites(imu, course: bool) -> None:
    """Within a minute of turns, whatever the heading was at first."""
    it = scenario(imu, duration=120.0)
    trajectory, samples = felt(it, 1)
    alignment = Alignment(filter_model(it), np.zeros(3), measured=True, aim=0.1, course=course)
    rng = np.random.default_rng(5)
    done = None
    for k in range(len(trajectory)):
        take(alignment, trajectory, samples, slice(k, k + 1))
        noise = rng.standard_normal(5)
        at = trajectory.latitude[k + 1] + noise[0] / 6.4e6, trajectory.longitude[k + 1]
        velocity = trajectory.velocity[k + 1] + 0.05 * noise[2:]
        alignment.measure(
            alignment.time,
            PositionFix(*at, np.eye(2)),
            GroundVelocity(velocity, 0.05**2 * np.eye(3), np.zeros(3)),
        )
        if done is None and alignment.aligned:
            done = k + 1
    assert done is not None and done < 70
    error, P = error_of(alignment, trajectory.attitude[-1]), alignment.state.covariance[6:9, 6:9]
    assert error @ np.linalg.solve(P, error) < 21.1  # one in 10,000 of three degrees of freedom
    assert alignment.heading_sigma < 0.05
    assert alignment.over


def test_an_odometer_alone_tells_no_heading() -> None:
    """Beside gyroscopes that cannot feel the Earth's rotation all headings stay as probable, and
    each as uncertain, as they were."""
    it = scenario(PHONE, duration=60.0)
    trajectory, samples = felt(it, 1)
    alignment = Alignment(filter_model(it), start_of(trajectory))
    noise = 0.1 * np.random.default_rng(5).standard_normal((60, 3))
    for k in range(60):
        take(alignment, trajectory, samples, slice(k, k + 1))
        body = matrix(trajectory.attitude[k + 1]).T @ trajectory.velocity[k + 1]
        reading = VelocityReading(body + noise[k], 0.01 * np.eye(3))
        assert alignment.measure(k + 1.0, reading).used
    known = alignment.known
    assert len(known.states) == HEADINGS
    assert np.ptp(known.log_weights) < 1.0
    for state in known.states:
        assert math.sqrt(state.covariance[8, 8]) > 0.9 * math.pi / HEADINGS


def test_a_vehicle_that_moves_off_is_no_longer_at_rest() -> None:
    it = scenario({"grade": "navigation"}, at_rest=60.0, duration=90.0)
    trajectory, samples = felt(it, 0)
    assert np.hypot(*trajectory.velocity[61, :2]) > 0.2
    watch = Standstill(filter_model(it))
    still = [watch.take(row[:3], row[3:], 1.0) for row in samples]
    assert all(still[:60])
    assert not still[60]


def test_samples_that_cannot_be_are_refused() -> None:
    it = Alignment(filter_model(scenario({"grade": "navigation"})), np.array([0.7, 0.1, 0.0]))
    it.imu(1.0, np.array([0.0, 0.0, -9.8]), np.zeros(3))
    with pytest.raises(ValueError, match="not later"):
        it.imu(1.0, np.array([0.0, 0.0, -9.8]), np.zeros(3))
    with pytest.raises(ValueError, match="not finite"):
        it.imu(2.0, np.array([0.0, np.nan, -9.8]), np.zeros(3))
    assert it.state.covariance[8, 8] == pytest.approx(UNKNOWN**2)
