"""The protection level: its risk against numerical integration, and its limits."""

import numpy as np
import pytest
from scipy import stats

from isogal.fusion.protection_level import (
    FREEDOM,
    HOUR,
    INFLATION,
    protection_level,
)


def turned(major: float, minor: float, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s], [s, c]])
    return rotation @ np.diag([major**2, minor**2]) @ rotation.T


def rate_by_quadrature(covariance: np.ndarray, radius: float, time: float) -> float:
    """Exceedances per hour, radius x density of the t distribution's distance per correlation
    time, by integrating its density around the circle."""
    law = stats.multivariate_t(shape=INFLATION * covariance, df=FREEDOM)
    phi = np.linspace(0.0, 2.0 * np.pi, 4096, endpoint=False)
    around = law.pdf(radius * np.stack([np.cos(phi), np.sin(phi)], axis=-1)).mean()
    return HOUR / time * radius * 2.0 * np.pi * radius * float(around)


@pytest.mark.parametrize("seed", range(5))
def test_the_level_has_the_risk_it_is_asked_for(seed):
    random = np.random.default_rng(seed)
    risk, time = 10.0 ** random.uniform(-9.0, -1.0), random.uniform(10.0, 3600.0)
    major = 10.0 ** random.uniform(-1.0, 5.0)
    covariance = turned(major, random.uniform(0.02, 1.0) * major, random.uniform(-3.0, 3.0))
    level = protection_level(covariance, risk, time)
    assert rate_by_quadrature(covariance, float(level), time) == pytest.approx(risk, rel=1e-4)
    once = protection_level(4.0 * covariance, risk, time)
    assert once == pytest.approx(2.0 * level, rel=1e-9)
    assert np.ndim(level) == 0


@pytest.mark.parametrize(
    ("covariance", "level"),
    [
        (np.full((2, 2), np.nan), np.inf),
        (np.diag([np.inf, 1.0]), np.inf),
        (np.diag([-1.0, 1.0]), np.inf),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), np.inf),
        (-np.eye(2), np.inf),
        (np.zeros((2, 2)), 0.0),
    ],
)
def test_what_is_no_covariance_promises_nothing_and_none_has_no_error(covariance, level):
    assert protection_level(covariance, 1e-5, 1000.0) == level


@pytest.mark.parametrize(("risk", "time"), [(0.0, 1000.0), (1e-5, 0.0), (1.0, 3600.0)])
def test_a_risk_that_is_no_rare_event_is_refused(risk, time):
    with pytest.raises(ValueError, match="risk x correlation time"):
        protection_level(np.eye(2), risk, time)
