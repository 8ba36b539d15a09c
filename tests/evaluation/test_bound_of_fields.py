"""The bound with readings of several channels, of several beams and of several fields."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.route_maps import field, waves
from helpers.sea_floor import SOUNDING, sea_floor
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.maps.channels import ChannelMap
from isogal.maps.error_model import displacements, tensor_covariance
from isogal.maps.potential import derivatives
from isogal.maps.several import FieldMaps
from isogal.scenario import Gradiometer, MapError, load_scenario, validate_scenario
from isogal.sensors.gradiometer import tilt_effect
from isogal.sensors.trajectory import build_trajectory

FIELD = replace(
    field(lambda n, e: 1e-8 * np.sin(n / 3e3 + e / 5e3)), unit="1/s²", quantity="gradient"
)
THREE = [[4.0, 1.0, 0.5], [1.0, 9.0, -2.0], [0.5, -2.0, 6.0]]
OUTLIERS = {"outlier_fraction": 0.2, "outlier_sigma": 30.0}


@pytest.mark.parametrize(
    ("many", "one", "map_sigma", "gravimeter"),
    [
        # the best linear combination of channels has the variance (1' R⁻¹ 1)⁻¹
        (THREE, [[1.0 / np.linalg.inv(THREE).sum()]], (0.0, 0.0), {}),
        ([[8.0, 0.0], [0.0, 8.0]], [[4.0]], (3e-9, 3e-9 / np.sqrt(2.0)), {}),
        ([[8.0, 0.0], [0.0, 8.0]], [[4.0]], (0.0, 0.0), OUTLIERS),
    ],
    ids=["correlated noise", "independent map errors", "outliers"],
)
def test_alike_channels_are_worth_as_much_as_one_with_less_noise(many, one, map_sigma, gravimeter):
    def bound(covariance, sigma, gravimeter):
        names = ("nn", "ne", "nd")[: len(covariance)]
        settings = validate_scenario(
            {
                "field": "gradient",
                "route": {"duration": 1800.0},
                "gradiometer": {"components": names, "covariance_eotvos": covariance},
                "map_error": {"sigma": sigma},
                "gravimeter": gravimeter,
            }
        )
        maps = ChannelMap([FIELD] * len(names))
        return posterior_cramer_rao(settings.true, build_trajectory(settings), maps).covariance

    found = bound(many, map_sigma[0], gravimeter)
    np.testing.assert_allclose(found, bound(one, map_sigma[1], gravimeter), rtol=1e-9)
    if gravimeter or any(map_sigma):
        assert found[-1, 0, 0] > bound(many, 0.0, {})[-1, 0, 0]


class TestOnePotential:
    """Errors that go together, against conditioning on all readings at once: a navigator whose
    position error is constant, on a route with a corner."""

    NOISE = np.diag([4.0, 9.0, 6.0, 5.0, 8.0]) + 3.0 * np.eye(5)[:, ::-1]
    """E², whose eigenvectors mix components."""
    SETTINGS = validate_scenario(
        {
            "field": "gradient",
            "gradiometer": {"covariance_eotvos": NOISE.tolist(), "map_errors": "one_potential"},
            "map_error": {"sigma": 1e-8, "correlation_length": 900.0},
            "imu": {"grade": "quantum"},
            "initial_error": {"position": 300.0, "velocity": 0.0, "tilt": 0.0, "heading": 0.0},
            "gravity": {"field": "normal"},
            "route": {
                "duration": 600.0,
                "waypoints": [(-37.8, 145.0, 20.0), (-37.76, 145.03, 20.0), (-37.76, 145.2, 20.0)],
            },
            "gravimeter": {"interval": 20.0},
        }
    )
    TRAJECTORY = build_trajectory(SETTINGS)
    SCANS = np.arange(20, len(TRAJECTORY) + 1, 20)
    ROWS, CHANNEL = np.repeat(SCANS, 5), np.tile(np.arange(5), len(SCANS))
    MAPS = derivatives(
        replace(
            field(lambda n, e: 1e-4 * np.sin(n / 700.0 + np.sin(e / 900.0)), step_deg=0.004),
            quantity="disturbance",
        ),
        SETTINGS.gradiometer.components,
        edge=10e3,
    )

    def dense(self, correlated):
        """RMS error at the end, given the covariance of what goes together beside the noise."""
        place = self.TRAJECTORY.latitude[self.SCANS], self.TRAJECTORY.longitude[self.SCANS]
        slopes = [one.value_and_gradient(*place)[1:] for one in self.MAPS.channels]
        slope = np.array(slopes).transpose(2, 0, 1).reshape(-1, 2)
        whole = correlated + 1e-18 * np.kron(np.eye(len(self.SCANS)), self.NOISE)
        told = slope.T @ np.linalg.solve(whole, slope)
        return np.sqrt(np.trace(np.linalg.inv(told + np.eye(2) / 300.0**2)))

    def test_map_errors(self):
        place = self.TRAJECTORY.latitude[self.ROWS], self.TRAJECTORY.longitude[self.ROWS]
        components = self.SETTINGS.gradiometer.components
        wrong = tensor_covariance(components, self.CHANNEL, displacements(*place), 900.0)
        expected = self.dense(1e-16 * wrong)
        bound = posterior_cramer_rao(self.SETTINGS.true, self.TRAJECTORY, self.MAPS, smoothed=True)
        np.testing.assert_allclose(bound.rms[-1], expected, rtol=0.05)
        # the error does not change on the way: afterwards it is known as well at any time
        later = np.sqrt(np.trace(bound.smoothed, axis1=1, axis2=2))
        np.testing.assert_allclose(later, bound.rms[-1], rtol=0.05)

    def test_tilt_and_walking_offsets(self):
        gradiometer = Gradiometer(
            covariance_eotvos=self.NOISE.tolist(),
            bias_eotvos=4.0,
            bias_walk_eotvos=0.5,
            platform_tilt=2e-3,
            platform_time=250.0,
        )
        settings = self.SETTINGS.model_copy(
            update={"gradiometer": gradiometer, "map_error": MapError()}
        )
        time = self.TRAJECTORY.time[self.ROWS]
        effect = tilt_effect(gradiometer.components, self.TRAJECTORY.latitude[self.ROWS])
        effect = effect[np.arange(len(time)), self.CHANNEL]
        tilted = 4e-6 * effect @ effect.T * np.exp(-np.abs(time[:, None] - time) / 250.0)
        walked = 16e-18 + 0.25e-18 * np.minimum(time[:, None], time)
        expected = self.dense(tilted + walked * (self.CHANNEL[:, None] == self.CHANNEL))
        found = posterior_cramer_rao(settings.true, self.TRAJECTORY, self.MAPS).rms[-1]
        np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_beams():
    """One straight down is a clearance meter; one twice has half of the noise; more tell more."""
    floor = sea_floor()

    def bound(*items):
        error = "map_error.sigma=2", "map_error.correlation_length=400", "gravimeter.bias=3"
        scenario = load_scenario(None, [*SOUNDING, *error, *items])
        return posterior_cramer_rao(scenario.true, build_trajectory(scenario), floor).rms

    np.testing.assert_allclose(bound("altimeter.directions=[[0, 0]]"), bound(), rtol=1e-9)
    twice = bound("altimeter.directions=[[0, 0], [0, 0]]")
    better = bound(f"gravimeter.sigma={0.5 / np.sqrt(2.0)}")
    np.testing.assert_allclose(twice, better, rtol=1e-9)
    five, nine = (
        bound(f"altimeter.beams={count}", "altimeter.opening=110")[-1] for count in (5, 9)
    )
    assert nine < five < 0.8 * bound()[-1]


GRAVITY = {"field": "gravity", "map_error": {"sigma": 1e-5}}
MAGNETIC = {"field": "magnetic", "sigma": 10.0, "map_error": {"sigma": 10.0}}
MAPS = {
    "gravity": field(waves),
    "magnetic": replace(
        field(lambda n, e: 1e6 * (waves(e, n) - 9.8)), unit="nT", quantity="magnetic_anomaly"
    ),
}


def joint(*fields):
    scenario = validate_scenario(
        {
            "route": {"duration": 1800.0},
            "gravity": {"field": "normal"},
            "fields": list(fields),
        }
    )
    maps = FieldMaps(tuple(MAPS[one["field"]] for one in fields))
    return posterior_cramer_rao(scenario.true, build_trajectory(scenario), maps)


def test_two_fields_are_better_than_each_and_in_any_order():
    both = joint(GRAVITY, MAGNETIC)
    turned = joint(MAGNETIC, GRAVITY)
    np.testing.assert_allclose(both.covariance, turned.covariance, rtol=1e-7)
    for one in (joint(GRAVITY), joint(MAGNETIC)):
        apart = one.covariance[-1] - both.covariance[-1]
        assert np.linalg.eigvalsh(apart)[0] > 0.0


def test_two_instruments_on_one_exact_map_are_one_with_half_the_variance():
    exact = {"field": "gravity", "sigma": 2e-5}
    half = {"field": "gravity", "sigma": 2e-5 / np.sqrt(2.0)}
    two = joint(exact, exact | {"name": "other"})
    np.testing.assert_allclose(two.covariance, joint(half).covariance, rtol=1e-9)
