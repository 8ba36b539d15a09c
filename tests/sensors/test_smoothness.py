"""How smooth a smoothing spline is, against scipy's."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from isogal.sensors.smoothness import smoothness


@pytest.mark.parametrize("count", [5, 6, 200])
@pytest.mark.parametrize("noise", [0.1, 1.0, 30.0])
def test_splines_are_as_smooth_as_those_of_scipy(count, noise):
    """Uneven steps and weights."""
    draw = np.random.default_rng(count)
    place = np.cumsum(draw.uniform(0.2, 2.0, count))
    values = 30.0 * np.sin(place / 8.0) + draw.normal(0.0, noise, count)
    weight = np.where(draw.random(count) < 0.1, 1e4, 1.0)
    right = make_smoothing_spline(place, values, w=weight)
    found = make_smoothing_spline(place, values, w=weight, lam=smoothness(place, values, weight))
    np.testing.assert_allclose(found(place), right(place), atol=1e-5 * noise)
