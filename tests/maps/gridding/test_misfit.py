"""The likelihood of readings against another library, its derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from isogal.maps.gridding.covariance import Covariance, Readings
from isogal.maps.gridding.misfit import IMPOSSIBLE, misfit

MATERN = Covariance("matern", (2.0, 3.0), (900.0, 4000.0), 0.3, 0.4, 1.7, 0.6)
HARMONIC = Covariance("harmonic", (2.0, 3.0), (900.0, 4000.0), 0.3)


def readings(line):
    random = np.random.default_rng(3)
    places = np.column_stack([random.uniform(0.0, 5e3, (40, 2)), random.uniform(0.0, 300.0, 40)])
    sigma = random.uniform(0.1, 0.2, 40)
    number = np.arange(40) // 10 if line else None
    return Readings(places, random.normal(0.0, 3.0, 40), sigma, number)


def changed(covariance, which, step):
    """A covariance with one of its parameters, in the order of the derivatives, changed."""
    up = np.exp(step)
    (s1, s2), (l1, l2) = covariance.sigma, covariance.length
    return replace(
        covariance,
        **[
            {"sigma": (s1 * up, s2)},
            {"length": (l1 * up, l2)},
            {"sigma": (s1, s2 * up)},
            {"length": (l1, l2 * up)},
            {"noise": covariance.noise * up},
            {"line": covariance.line * up},
            {"ratio": covariance.ratio * up},
            {"strike": covariance.strike + step},
        ][which],
    )


@pytest.mark.parametrize(
    ("covariance", "parameters"), [(MATERN, range(8)), (HARMONIC, range(5))], ids=["m", "h"]
)
def test_it_is_the_normal_distributions_and_its_derivatives_are_its_differences(
    covariance, parameters
):
    given = readings(covariance is MATERN)
    cost, slopes = misfit(covariance, 5.0, given)
    R = covariance.of_readings(given) + 25.0
    density = multivariate_normal(np.zeros(40), R).logpdf(given.value)
    assert cost == pytest.approx(-density - 20.0 * np.log(2.0 * np.pi))
    assert len(slopes) == len(parameters)
    for which, slope in zip(parameters, slopes, strict=True):
        up, down = (misfit(changed(covariance, which, s), 5.0, given)[0] for s in (1e-5, -1e-5))
        assert slope == pytest.approx((up - down) / 2e-5, rel=1e-4, abs=1e-5), which


def test_what_is_not_positive_definite_is_impossible():
    nothing = replace(MATERN, sigma=(0.0, 0.0), noise=0.0)
    cost, slopes = misfit(nothing, 0.0, replace(readings(True), sigma=None))
    assert cost == IMPOSSIBLE
    assert not slopes.any()
    assert slopes.size == 8
