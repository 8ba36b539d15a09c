"""The bound with readings of several channels."""

from dataclasses import replace
from typing import Any

import numpy as np

from helpers.route_maps import field
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.maps.channels import ChannelMap
from isogal.scenario import validate_scenario
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
