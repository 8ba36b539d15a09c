"""The bound with readings of several channels."""

from dataclasses import replace
from typing import Any

import numpy as np

from helpers.route_maps import field
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.bound_several import joint_bound
from isogal.maps.channels import ChannelMap
from isogal.maps.gradients import tensor_maps
from isogal.maps.tensor_error import displacements, tensor_covariance
from isogal.scenario import Gradiometer, validate_scenario
from isogal.sensors.trajectory import build_trajectory


class TestChannels:
    """Channels with the same sensitivity are worth as much as one with less noise."""

    FIELD = field(lambda n, e: 1e-8 * np.sin(n / 3e3 + e / 5e3))

    def bound(
        self, covariance: list[list[float]], map_sigma: float = 0.0, **keys: Any
    ) -> np.ndarray:
        names = ("nn", "ne", "nd")[: len(covariance)]
        settings = validate_scenario(
            {
                "field": "gradient",
                "route": {"duration": 1800.0},
                "gradiometer": {"components": names, "covariance_eotvos": covariance},
                "map_error": {"sigma": map_sigma},
                **keys,
            }
        )
        one = replace(self.FIELD, unit="1/s²", quantity="gradient")
        return posterior_cramer_rao(
            settings, build_trajectory(settings), ChannelMap([one] * len(names))
        ).covariance

    def test_noise_of_one_and_of_two(self) -> None:
        np.testing.assert_allclose(
            self.bound([[8.0, 0.0], [0.0, 8.0]]), self.bound([[4.0]]), rtol=1e-9
        )

    def test_correlated_noise(self) -> None:
        # the best linear combination of both has the variance (1' R⁻¹ 1)⁻¹: (a + b) / 2
        # of equal ones
        np.testing.assert_allclose(
            self.bound([[4.0, 2.0], [2.0, 4.0]]), self.bound([[3.0]]), rtol=1e-9
        )
        three = [[4.0, 1.0, 0.5], [1.0, 9.0, -2.0], [0.5, -2.0, 6.0]]
        weighted = 1.0 / np.linalg.inv(three).sum()
        np.testing.assert_allclose(self.bound(three), self.bound([[weighted]]), rtol=1e-9)

    def test_map_errors_of_two_channels_are_independent(self) -> None:
        two = self.bound([[8.0, 0.0], [0.0, 8.0]], 3e-9)
        np.testing.assert_allclose(two, self.bound([[4.0]], 3e-9 / np.sqrt(2.0)), rtol=1e-9)
        assert (two[-1] > self.bound([[8.0, 0.0], [0.0, 8.0]])[-1]).any()

    def test_outliers(self) -> None:
        keys = {"gravimeter": {"outlier_fraction": 0.2, "outlier_sigma": 30.0}}
        np.testing.assert_allclose(
            self.bound([[8.0, 0.0], [0.0, 8.0]], **keys), self.bound([[4.0]], **keys), rtol=1e-9
        )
        assert self.bound([[4.0]], **keys)[-1, 0, 0] > self.bound([[4.0]])[-1, 0, 0]


class TestOnePotential:
    """Map errors that go together, against conditioning on all readings at once: a navigator whose
    position error is constant, on a route with a corner."""

    SETTINGS = validate_scenario(
        {
            "field": "gradient",
            "gradiometer": {"sigma_eotvos": 3.0, "map_errors": "one_potential"},
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
    MAPS = tensor_maps(
        replace(
            field(lambda n, e: 1e-4 * np.sin(n / 700.0 + np.sin(e / 900.0)), step_deg=0.004),
            quantity="disturbance",
        ),
        SETTINGS.gradiometer.components,
        edge=10e3,
    )

    def test_it_is_near_the_dense_one(self) -> None:
        settings, trajectory = self.SETTINGS, self.TRAJECTORY
        scans = np.arange(20, len(trajectory) + 1, 20)
        latitude, longitude = trajectory.latitude[scans], trajectory.longitude[scans]
        slopes = [one.value_and_gradient(latitude, longitude)[1:] for one in self.MAPS.channels]
        slope = np.array(slopes).transpose(2, 0, 1).reshape(-1, 2)
        rows, channel = np.repeat(scans, 5), np.tile(np.arange(5), len(scans))
        apart = displacements(trajectory.latitude[rows], trajectory.longitude[rows])
        wrong = tensor_covariance(settings.gradiometer.components, channel, apart, 900.0)
        whole = 1e-16 * wrong + 9e-18 * np.eye(len(rows))
        dense = np.linalg.inv(slope.T @ np.linalg.solve(whole, slope) + np.eye(2) / 300.0**2)
        bound = posterior_cramer_rao(settings, trajectory, self.MAPS)
        found = np.sqrt(np.trace(bound.covariance[-1]))
        np.testing.assert_allclose(found, np.sqrt(np.trace(dense)), rtol=0.05)
        # another bound than that of errors that do not go together
        alone = settings.model_copy(update={"gradiometer": Gradiometer(sigma_eotvos=3.0)})
        other = posterior_cramer_rao(alone, trajectory, self.MAPS).covariance[-1]
        assert abs(np.sqrt(np.trace(other)) / found - 1.0) > 0.1

    def test_the_joint_bound_of_one_field_is_the_same(self) -> None:
        one = posterior_cramer_rao(self.SETTINGS, self.TRAJECTORY, self.MAPS)
        joint = joint_bound(self.SETTINGS, self.TRAJECTORY, [self.MAPS])
        np.testing.assert_allclose(joint.covariance, one.covariance, rtol=1e-9)
