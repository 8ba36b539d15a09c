"""The bound with readings of several channels."""

from dataclasses import replace

import numpy as np

from helpers.route_maps import field
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.maps.channels import ChannelMap
from isogal.maps.error_model import displacements, tensor_covariance
from isogal.maps.potential import derivatives
from isogal.scenario import Gradiometer, MapError, validate_scenario
from isogal.sensors.gradiometer_errors import tilt_effect
from isogal.sensors.trajectory import build_trajectory


class TestChannels:
    """Channels with the same sensitivity are worth as much as one with less noise."""

    FIELD = field(lambda n, e: 1e-8 * np.sin(n / 3e3 + e / 5e3))

    def bound(self, covariance, map_sigma=0.0, **keys):
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
            settings.true, build_trajectory(settings), ChannelMap([one] * len(names))
        ).covariance

    def test_correlated_noise(self) -> None:
        # the best linear combination of both has the variance (1' R⁻¹ 1)⁻¹: (a + b) / 2
        # of equal ones
        np.testing.assert_allclose(
            self.bound([[4.0, 2.0], [2.0, 4.0]]), self.bound([[3.0]]), rtol=1e-9
        )
        three = [[4.0, 1.0, 0.5], [1.0, 9.0, -2.0], [0.5, -2.0, 6.0]]
        weighted = 1.0 / np.linalg.inv(three).sum()
        np.testing.assert_allclose(self.bound(three), self.bound([[weighted]]), rtol=1e-9)

    def test_map_errors_of_two_channels_are_independent(self):
        two = self.bound([[8.0, 0.0], [0.0, 8.0]], 3e-9)
        np.testing.assert_allclose(two, self.bound([[4.0]], 3e-9 / np.sqrt(2.0)), rtol=1e-9)
        assert (two[-1] > self.bound([[8.0, 0.0], [0.0, 8.0]])[-1]).any()

    def test_outliers(self):
        keys = {"gravimeter": {"outlier_fraction": 0.2, "outlier_sigma": 30.0}}
        np.testing.assert_allclose(
            self.bound([[8.0, 0.0], [0.0, 8.0]], **keys), self.bound([[4.0]], **keys), rtol=1e-9
        )
        assert self.bound([[4.0]], **keys)[-1, 0, 0] > self.bound([[4.0]])[-1, 0, 0]


class TestOnePotential:
    """Map errors that go together, against conditioning on all readings at once: a navigator whose
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
    MAPS = derivatives(
        replace(
            field(lambda n, e: 1e-4 * np.sin(n / 700.0 + np.sin(e / 900.0)), step_deg=0.004),
            quantity="disturbance",
        ),
        SETTINGS.gradiometer.components,
        edge=10e3,
    )

    def test_it_is_near_the_dense_one(self):
        settings, trajectory = self.SETTINGS, self.TRAJECTORY
        scans, slope = self._slopes()
        rows, channel = np.repeat(scans, 5), np.tile(np.arange(5), len(scans))
        apart = displacements(trajectory.latitude[rows], trajectory.longitude[rows])
        wrong = tensor_covariance(settings.gradiometer.components, channel, apart, 900.0)
        whole = 1e-16 * wrong + 1e-18 * np.kron(np.eye(len(scans)), self.NOISE)
        dense = np.linalg.inv(slope.T @ np.linalg.solve(whole, slope) + np.eye(2) / 300.0**2)
        bound = posterior_cramer_rao(settings.true, trajectory, self.MAPS, smoothed=True)
        found = np.sqrt(np.trace(bound.covariance[-1]))
        np.testing.assert_allclose(found, np.sqrt(np.trace(dense)), rtol=0.05)
        # the error does not change on the way: afterwards it is known as well at any time
        assert bound.smoothed is not None
        later = np.sqrt(np.trace(bound.smoothed, axis1=1, axis2=2))
        np.testing.assert_allclose(later, found, rtol=0.05)
        # another bound than that of errors that do not go together
        alone = settings.model_copy(
            update={"gradiometer": Gradiometer(covariance_eotvos=self.NOISE.tolist())}
        )
        other = posterior_cramer_rao(alone.true, trajectory, self.MAPS).covariance[-1]
        assert abs(np.sqrt(np.trace(other)) / found - 1.0) > 0.1

    def test_tilt_and_walking_offsets(self):
        told = {
            "covariance_eotvos": self.NOISE.tolist(), "bias_eotvos": 4.0,
            "bias_walk_eotvos": 0.5, "platform_tilt": 2e-3, "platform_time": 250.0,
        }  # fmt: skip
        settings = self.SETTINGS.model_copy(
            update={"gradiometer": Gradiometer(**told), "map_error": MapError()}
        )
        trajectory = self.TRAJECTORY
        scans, slope = self._slopes()
        time = np.repeat(trajectory.time[scans], 5)
        channel = np.tile(np.arange(5), len(scans))
        latitude = trajectory.latitude[np.repeat(scans, 5)]
        effect = tilt_effect(settings.gradiometer.components, latitude)
        effect = effect[np.arange(len(channel)), channel]
        apart = np.abs(time[:, None] - time)
        whole = 1e-18 * np.kron(np.eye(len(scans)), self.NOISE)
        whole += 4e-6 * effect @ effect.T * np.exp(-apart / 250.0)
        walked = 16e-18 + 0.25e-18 * np.minimum(time[:, None], time)
        whole += walked * (channel[:, None] == channel)
        dense = np.linalg.inv(slope.T @ np.linalg.solve(whole, slope) + np.eye(2) / 300.0**2)
        bound = posterior_cramer_rao(settings.true, trajectory, self.MAPS)
        found = np.sqrt(np.trace(bound.covariance[-1]))
        np.testing.assert_allclose(found, np.sqrt(np.trace(dense)), rtol=2e-3)
        # what each of them costs
        for key in ("platform_tilt", "bias_eotvos", "bias_walk_eotvos"):
            without = Gradiometer(**(told | {key: 0.0}))
            less = settings.model_copy(update={"gradiometer": without})
            other = posterior_cramer_rao(less.true, trajectory, self.MAPS).covariance[-1]
            assert np.sqrt(np.trace(other)) < 0.995 * found, key

    def _slopes(self):
        """Index of the scans, and the readings' derivatives (5 scans, 2) by the position error."""
        trajectory = self.TRAJECTORY
        scans = np.arange(20, len(trajectory) + 1, 20)
        latitude, longitude = trajectory.latitude[scans], trajectory.longitude[scans]
        slopes = [one.value_and_gradient(latitude, longitude)[1:] for one in self.MAPS.channels]
        return scans, np.array(slopes).transpose(2, 0, 1).reshape(-1, 2)
