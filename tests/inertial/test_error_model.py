"""The linear error model against differences of the strapdown itself."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from isogal.earth.ellipsoid import radii
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.inertial.error_state import Estimate
from isogal.inertial.strapdown import propagate

R, W = 6.38e6, 1.24e-3  # radius and Schuler rate bring all states to one size
SIZE = np.array([R, R, R * W, R * W, 1.0, 1.0, 1.0, 9.8, 9.8, 9.8, W, W, W])
DT = 0.1


def metres(nav: Estimate) -> np.ndarray:
    latitude, _, height = nav.position[0]
    meridian, normal = radii(latitude)
    return np.array([meridian + height, (normal + height) * np.cos(latitude)])


def moved(nav: Estimate, error: np.ndarray) -> Estimate:
    attitude = Rotation.from_rotvec(error[4:7]) * Rotation.from_quat(
        nav.attitude[0], scalar_first=True
    )
    return Estimate(
        nav.position + np.append(error[:2] / metres(nav), 0.0),
        nav.velocity + np.append(error[2:4], 0.0),
        attitude.as_quat(scalar_first=True)[None],
    )


def difference(a: Estimate, b: Estimate, middle: Estimate) -> np.ndarray:
    turn = (
        Rotation.from_quat(a.attitude[0], scalar_first=True)
        * Rotation.from_quat(b.attitude[0], scalar_first=True).inv()
    )
    return np.concatenate(
        [
            (a.position - b.position)[0, :2] * metres(middle),
            (a.velocity - b.velocity)[0, :2],
            turn.as_rotvec(),
        ]
    )


@pytest.mark.parametrize("latitude", [-0.66, 0.0, 1.1])
@pytest.mark.parametrize("velocity", [(14.0, 17.0), (-200.0, 150.0)])
def test_dynamics_are_those_of_the_strapdown(latitude, velocity):
    random = np.random.default_rng(7)
    body = Rotation.random(None, random)
    nav = Estimate(
        np.array([[latitude, 2.5, 3000.0]]),
        np.array([[*velocity, 0.0]]),
        body.as_quat(scalar_first=True)[None],
    )
    force, rate = body.inv().apply([1.5, -2.0, -9.8]), np.array([1e-4, -2e-4, 1e-4])
    height = np.full(2, 3000.0)

    def run(error: np.ndarray) -> Estimate:
        f, w = force + error[7:10], rate + error[10:13]
        return propagate(moved(nav, error), f[None, None], w[None, None], DT, height)[0]

    middle = run(np.zeros(STATES))
    numeric = np.zeros((7, STATES))
    for j in range(STATES):
        step = np.zeros(STATES)
        step[j] = 1e-4 * SIZE[j]
        numeric[:, j] = difference(run(step), run(-step), middle) / SIZE[:7] / 2e-4
    F = np.zeros((STATES, STATES))
    meridian, normal = radii(latitude)
    v = 0.5 * (nav.velocity + middle.velocity)[0]
    geometry = np.array([latitude, v[0], v[1], 1.0 / (meridian + 3000.0), 1.0 / (normal + 3000.0)])
    fill_dynamics(F, geometry, body.apply(force), np.array(body.as_matrix(), order="C"))
    model = expm(F * DT)[:7] * SIZE / SIZE[:7, None]
    # in these units F consists of terms like W and, a seventeenth of it, the Earth's rate
    np.testing.assert_allclose((numeric - model) / (W * DT), 0.0, atol=1e-3)
