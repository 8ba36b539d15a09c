"""The protection level: probabilities of an ellipse against numerical integration, its limits, and
exceedances of simulated errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, special, stats

from isogal.evaluation.integrity import excursions
from isogal.fusion.protection_level import (
    FREEDOM,
    HOUR,
    INFLATION,
    axes,
    exceedance_probability,
    exceedance_rate,
    protection_level,
)

GAUSSIAN = (1.0, np.inf)
"""Inflation and freedom."""
RISKS = st.floats(1e-9, 0.1)
TIMES = st.floats(10.0, 3600.0)
RATIOS = st.floats(0.0, 1.0)


def turned(major: float, minor: float, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s], [s, c]])
    return rotation @ np.diag([major**2, minor**2]) @ rotation.T


def outside_by_quadrature(covariance: np.ndarray, radius: float, t: bool) -> float:
    """Probability outside of a circle by integrating the density inside of it, in rectangular
    coordinates."""
    shape = INFLATION * covariance if t else covariance
    law = stats.multivariate_t(shape=shape, df=FREEDOM) if t else stats.multivariate_normal
    density = law.pdf if t else lambda x: stats.multivariate_normal.pdf(x, cov=shape)
    nodes, weights = special.roots_legendre(160)
    half = radius * np.cos(0.5 * np.pi * nodes)  # of the chord at radius x sin(pi nodes / 2)
    north = np.broadcast_to(radius * np.sin(0.5 * np.pi * nodes)[:, None], (160, 160))
    points = np.stack([north, half[:, None] * nodes], axis=-1)
    return 1.0 - 0.5 * np.pi * float((weights * half**2) @ (density(points) @ weights))


@pytest.mark.parametrize("t", [False, True])
@pytest.mark.parametrize("minor", [30.0, 12.0, 5.0])
@pytest.mark.parametrize("radius", [20.0, 60.0, 100.0])
def test_the_probability_is_that_of_numerical_integration(minor, radius, t):
    covariance = turned(30.0, minor, 0.7)
    law = () if t else GAUSSIAN
    expected = outside_by_quadrature(covariance, radius, t)
    assert exceedance_probability(covariance, radius, *law) == pytest.approx(expected, abs=1e-9)


def test_far_out_it_is_that_of_numerical_integration():
    """Where nearly all is inside, the density outside is integrated instead."""
    covariance, radius = np.diag([1.0, 0.2]) * 900.0, 160.0

    def density(r, phi):
        x = np.array([r * np.cos(phi), r * np.sin(phi)])
        exponent = x @ np.linalg.solve(covariance, x)
        return r * np.exp(-0.5 * exponent) / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))

    expected = 4.0 * integrate.dblquad(density, 0.0, np.pi / 2, radius, 600.0, epsabs=1e-12)[0]
    got = exceedance_probability(covariance, radius, *GAUSSIAN)
    assert got == pytest.approx(expected, rel=1e-5)


def test_a_circle_and_a_line_are_rayleigh_and_normal():
    radius = np.linspace(0.5, 6.0, 12)
    circle = exceedance_probability(np.eye(2), radius, *GAUSSIAN)
    np.testing.assert_allclose(circle, stats.rayleigh.sf(radius), rtol=1e-12)
    line = exceedance_probability(np.diag([1.0, 0.0]), radius, *GAUSSIAN)
    np.testing.assert_allclose(line, 2.0 * stats.norm.sf(radius), rtol=1e-9)
    t = exceedance_probability(np.diag([1.0, 0.0]), radius, 1.0, FREEDOM)
    np.testing.assert_allclose(t, 2.0 * stats.t.sf(radius, FREEDOM), rtol=1e-9)


def test_the_rate_is_the_density_times_the_radius():
    covariance, radius, step = turned(40.0, 17.0, -0.4), 110.0, 1e-3
    ends = exceedance_probability(covariance, radius + step * np.array([-0.5, 0.5]))
    density = -float(np.diff(ends)[0]) / step
    rate = exceedance_rate(covariance, radius, 500.0)
    assert rate == pytest.approx(HOUR / 500.0 * radius * density, rel=1e-7)


def test_the_rate_is_that_of_the_first_exit_of_a_gauss_markov_process():
    """The mean time in which such an error, of equal sigmas, first leaves a circle is known:
    (Ei(x) - log x - Euler's constant) / 2 times the correlation time, x half of the squared
    radius. The rate is its inverse for large radii, and above it by a third at most."""
    radius = np.array([2.0, 3.0, 4.0, 5.0, 6.0, 8.0])
    x = radius**2 / 2.0
    exit_time = 0.5 * (special.expi(x) - np.log(x) - np.euler_gamma)
    product = exceedance_rate(np.eye(2), radius, HOUR, *GAUSSIAN) * exit_time
    assert np.all((product > 0.99) & (product < 4 / 3))
    assert np.all(np.diff(product[2:]) < 0.0)
    assert product[-1] < 1.05


@given(RISKS, TIMES, RATIOS, st.floats(-3.0, 3.0), st.floats(0.1, 1e5))
def test_the_level_has_the_risk_it_is_asked_for(risk, time, ratio, angle, major):
    covariance = turned(major, ratio * major, angle)
    level = protection_level(covariance, risk, time)
    assert exceedance_rate(covariance, level, time) == pytest.approx(risk, rel=1e-4)
    once = protection_level(4.0 * covariance, risk, time)
    assert once == pytest.approx(2.0 * level, rel=1e-9)
    assert np.ndim(level) == 0


@given(RISKS, TIMES)
def test_it_grows_from_the_line_to_the_circle(risk, time):
    ratios = np.linspace(0.0, 1.0, 21)
    covariance = np.zeros((21, 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = 1.0, ratios**2
    level = protection_level(covariance, risk, time)
    assert np.all(np.diff(level) > 0.0)
    # of a circle the equation is one line: x (1 + x / nu)^(-nu / 2 - 1) = risk x time
    x = level[-1] ** 2 / INFLATION
    rate = x * (1.0 + x / FREEDOM) ** (-FREEDOM / 2.0 - 1.0)
    assert rate == pytest.approx(risk * time / HOUR, rel=1e-4)


@given(TIMES, RATIOS)
def test_it_grows_as_the_risk_and_the_time_fall(time, ratio):
    covariance = np.diag([1.0, ratio**2])
    levels = [protection_level(covariance, risk, time) for risk in (1e-1, 1e-3, 1e-5, 1e-9)]
    assert np.all(np.diff(levels) > 0.0)
    assert protection_level(covariance, 1e-3, 10.0) >= protection_level(covariance, 1e-3, time)


def test_runs_stand_side_by_side():
    random = np.random.default_rng(5)
    factor = random.standard_normal((3, 4, 2, 2))
    covariance = factor @ np.swapaxes(factor, -1, -2)
    level = protection_level(covariance, 1e-4, 700.0)
    assert level.shape == (3, 4)
    assert level[1, 2] == protection_level(covariance[1, 2], 1e-4, 700.0)
    values = np.sqrt(np.linalg.eigvalsh(covariance))
    major, minor = axes(covariance)
    np.testing.assert_allclose(np.stack([minor, major], axis=-1), values, rtol=1e-6)


@pytest.mark.parametrize(
    "covariance",
    [
        np.full((2, 2), np.nan),
        np.diag([np.inf, 1.0]),
        np.diag([-1.0, 1.0]),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
        -np.eye(2),
    ],
)
def test_what_is_no_covariance_promises_nothing(covariance):
    assert protection_level(covariance, 1e-5, 1000.0) == np.inf


def test_an_exact_position_has_no_error():
    assert protection_level(np.zeros((2, 2)), 1e-5, 1000.0) == 0.0


@pytest.mark.parametrize(("risk", "time"), [(0.0, 1000.0), (1e-5, 0.0), (1.0, 3600.0)])
def test_a_risk_that_is_no_rare_event_is_refused(risk, time):
    with pytest.raises(ValueError, match="risk x correlation time"):
        protection_level(np.eye(2), risk, time)


@pytest.mark.parametrize("minor", [1.0, 0.3])
def test_simulated_errors_exceed_it_as_often_as_stated(minor):
    """Gauss-Markov errors of the claimed covariance, with the tails that the level allows for,
    4,000 h in states 10 s apart. Above the level between states they are not seen, and the level
    errs on the safe side by a third at most, so between 0.5 and 1 of the risk is expected; 400 x
    0.7 +- 3 sigma is 0.57 to 0.83, and 40 x 0.7 is 0.3 to 1.1."""
    runs, states, step, time = 250, 5760, 10.0, 1000.0
    random = np.random.default_rng(11)
    keep = np.exp(-step / time)
    error = random.standard_normal((runs, states, 2))
    error[:, 1:] *= np.sqrt(1.0 - keep**2)
    for k in range(1, states):
        error[:, k] += keep * error[:, k - 1]
    wide = np.sqrt(INFLATION * FREEDOM / random.chisquare(FREEDOM, runs))
    distance = np.hypot(error[..., 0], minor * error[..., 1]) * wide[:, None]
    hours = runs * states * step / HOUR
    for risk, low, high in ((0.1, 0.5, 0.9), (0.01, 0.3, 1.1)):
        level = protection_level(np.diag([1.0, minor**2]), risk, time)
        events = excursions(distance > level, np.arange(states) * step, time).sum()
        assert low < events / hours / risk < high
