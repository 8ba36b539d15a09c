"""Fast samples brought to the strapdown's rate: against analytic coning and the
strapdown at the fast rate."""

import numpy as np

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
