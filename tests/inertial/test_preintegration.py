"""Fast samples brought to the strapdown's rate: against rotations by SciPy, analytic coning and
sculling, and the strapdown at the fast rate."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from isogal.earth.frames import horizontal_difference
from isogal.inertial.error_state import Estimate
from isogal.inertial.preintegration import preintegrate
from isogal.inertial.rotations import multiply
from isogal.inertial.strapdown import propagate
from isogal.scenario import Fusion, Imu, Route, Scenario
from isogal.sensors.imu import true_samples
from isogal.sensors.trajectory import build_trajectory

GAUSS = np.polynomial.legendre.leggauss(5)


def means(function, rate, seconds):
    """Means of a vector function of time over samples of a rate, by quadrature."""
    starts = np.arange(round(rate * seconds)) / rate
    total = 0.0
    for node, weight in zip(*GAUSS, strict=True):
        total = total + 0.5 * weight * function(starts + 0.5 * (node + 1.0) / rate)
    return total


def regular(rate, seconds, step=1.0):
    """Durations of samples, and the ends of intervals."""
    samples = round(rate * seconds)
    return np.full(samples, 1.0 / rate), np.arange(0, samples + 1, round(rate * step))


def coning(angle, frequency):
    """Attitude (rotation vectors) and body rate of a classical coning motion: the attitude comes
    back after each period, while the rate about z has a mean of -Omega (1 - cos angle)."""
    omega = 2.0 * np.pi * frequency

    def attitude(t):
        return angle * np.stack([np.cos(omega * t), np.sin(omega * t), 0.0 * t], axis=-1)

    def rate(t):
        s, down = omega * np.sin(angle), -omega * (1.0 - np.cos(angle))
        return np.stack([-s * np.sin(omega * t), s * np.cos(omega * t), down + 0.0 * t], axis=-1)

    return attitude, rate


@pytest.mark.parametrize("angle", [np.radians(0.1), np.radians(1.0), np.radians(5.0)])
def test_coning_drift_is_the_analytic_one_without_and_none_with_the_correction(angle):
    frequency, fast = 10.0, 200.0
    attitude, rate = coning(angle, frequency)
    samples = means(rate, fast, 60.0)
    duration, ends = regular(fast, 60.0)
    drift = 2.0 * np.pi * frequency * (1.0 - np.cos(angle))
    plain = samples.sum(axis=0) / fast
    assert plain[2] == pytest.approx(-drift * 60.0, rel=1e-9)
    _, mean = preintegrate(np.zeros((1, *samples.shape)), samples[None], duration, ends)
    turned = Rotation.from_rotvec(attitude(np.zeros(1))[0])
    for one in mean[0]:
        turned = turned * Rotation.from_rotvec(one)
    left = (Rotation.from_rotvec(attitude(np.zeros(1))[0]).inv() * turned).as_rotvec()
    # what is left is known as well: Omega theta² (Omega h)^4 / 960 for h = 2 T, the two samples
    # that the rate within one is taken from (Titterton & Weston 2004, section 11.3)
    residual = drift * 60.0 * (2.0 * np.pi * frequency / fast) ** 4 / 30.0
    assert np.linalg.norm(left) == pytest.approx(residual, rel=0.05)


def reference(force, rate, duration, parts=200):
    """Rotation and velocity increment of one interval of samples, each constant, by SciPy with
    so many parts of each sample."""
    turned, velocity = Rotation.identity(), np.zeros(3)
    for f, w, t in zip(force, rate, duration, strict=True):
        part = Rotation.from_rotvec(w * t / parts)
        half = Rotation.from_rotvec(0.5 * w * t / parts)
        for _ in range(parts):
            velocity += (turned * half).apply(f * t / parts)
            turned = turned * part
    return turned.as_rotvec(), velocity


def made_of(force, rate, seconds):
    """What the strapdown's step makes of a mean force and rate."""
    a, u = rate * seconds, force * seconds
    cross = np.cross(a, u)
    return u + 0.5 * cross + np.cross(a, cross) / 6.0


def test_correction_within_a_sample_with_unequal_durations():
    """Rate and force that change linearly: the corrections are exact to third order."""

    def rate(t):
        return np.array([0.2, 0.3, 0.1]) + np.outer(t, [1.0, -2.0, 0.5])

    def force(t):
        return np.array([3.0, 1.0, -9.0]) + np.outer(t, [-4.0, 2.0, 1.0])

    edges = np.array([0.0, 0.03, 0.05])
    duration = np.diff(edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    samples = force(middle)[None], rate(middle)[None]  # means of linear functions
    f, w = preintegrate(*samples, duration, np.array([1, 2]))
    fine = np.linspace(edges[1], edges[2], 2001)
    between = 0.5 * (fine[1:] + fine[:-1])
    phi, velocity = reference(force(between), rate(between), np.diff(fine), parts=1)
    np.testing.assert_allclose(w[0, 0] * duration[1], phi, rtol=0, atol=2e-9)
    made = made_of(f[0, 0], w[0, 0], duration[1])
    np.testing.assert_allclose(made, velocity, rtol=0, atol=2e-7)
    # without the sample before, the corrections within the sample are missing
    _, alone = preintegrate(*(one[:, 1:] for one in samples), duration[1:], np.array([0, 1]))
    assert np.abs(alone - w).max() * duration[1] > 1e-7


def test_turns_are_as_right_at_1_hz_of_50_hz_samples_as_of_means():
    """Three right angles at 0.02 rad/s. What a step of means makes of pre-integrated samples is
    wrong by 2e-9 rad/s in them."""
    corners = ((-38.0, 144.5, 22.0), (-37.98, 144.5, 22.0), (-37.98, 144.53, 22.0),
               (-37.96, 144.53, 22.0), (-37.96, 144.56, 22.0))  # fmt: skip
    route = Route(duration=None, waypoints=corners)
    scenario = Scenario(route=route, imu=Imu(rate=50.0), fusion=Fusion(rate=1.0))
    truth, samples = build_trajectory(scenario), true_samples(scenario)[None]
    means_of = truth.specific_force[None], truth.angular_rate[None]
    duration, ends = regular(50.0, len(truth))
    place = np.array([[truth.latitude[0], truth.longitude[0], truth.height[0]]])
    start = Estimate(place, truth.velocity[:1], truth.attitude[:1])
    pieces = preintegrate(samples[..., :3], samples[..., 3:], duration, ends)

    def tilt(end):
        w, x, y, z = truth.attitude[-1]
        return 2.0 * np.linalg.norm(multiply(*end.attitude[0], w, -x, -y, -z)[1:])

    right, _ = propagate(start, *pieces, 1.0, truth.height, preintegrated=True)
    wrong, _ = propagate(start, *pieces, 1.0, truth.height)
    slow, _ = propagate(start, *means_of, 1.0, truth.height)
    assert tilt(slow) < 4e-8
    assert tilt(right) < 6e-8
    assert tilt(wrong) > 4e-7
    apart = horizontal_difference(*right.position[0, :2], *slow.position[0, :2])
    assert np.hypot(*apart) < 0.05
