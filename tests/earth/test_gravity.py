"""Normal gravity and the Eötvös acceleration against published values and boule's closed
formula."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isogal.earth.gravity import (
    GRAVITY_RATIO,
    eotvos,
    eotvos_jacobian,
    normal_gravity,
    normal_gravity_at,
    normal_gravity_gradient_north,
)

MGAL = 1e-5
KNOT = 1852.0 / 3600.0


@pytest.mark.parametrize(
    ("latitude", "published"),
    [(0.0, 9.7803267715), (45.0, 9.806199203), (-45.0, 9.806199203), (90.0, 9.8321863685)],
)
def test_normal_gravity_is_the_published_one(latitude, published):
    assert normal_gravity(np.radians(latitude)) == pytest.approx(published, abs=1e-9)


def test_gravity_ratio_is_the_published_one():
    assert pytest.approx(0.00344978600308, abs=1e-14) == GRAVITY_RATIO


@pytest.mark.parametrize(("height", "within"), [(0.0, 1e-9), (100.0, 1.5e-8), (9000.0, 2e-6)])
def test_normal_gravity_equals_boule(height, within):
    import boule  # takes a second, also where no test of this file runs

    latitude = np.linspace(-90.0, 90.0, 37)
    expected = boule.GRS80.normal_gravity(
        (np.zeros(37), latitude, np.full(37, height)), si_units=True
    )
    np.testing.assert_allclose(
        normal_gravity(np.radians(latitude), height), expected, rtol=0, atol=within
    )


@given(st.floats(-1.55, 1.55))
def test_gradient_to_the_north_against_finite_differences(latitude):
    step = 1e-5
    metres = 6335439.3271 / (1.0 - 0.00669438 * np.sin(latitude) ** 2) ** 1.5 * 2 * step
    difference = (normal_gravity(latitude + step) - normal_gravity(latitude - step)) / metres
    assert normal_gravity_gradient_north(latitude) == pytest.approx(
        float(difference), abs=1e-15, rel=1e-6
    )


@pytest.mark.parametrize(
    ("latitude", "course", "knots"), [(36.5, 57.0, 43.0), (0.0, 90.0, 10.0), (60.0, 270.0, 20.0)]
)
def test_eotvos_against_the_published_formula(latitude, course, knots):
    # 7.503 v cos(lat) sin(course) + 0.004154 v² mGal, v in knots (Glicken 1962; Dehlinger 1978,
    # Marine Gravity)
    published = (
        7.503 * knots * np.cos(np.radians(latitude)) * np.sin(np.radians(course))
        + 0.004154 * knots**2
    ) * MGAL
    speed, course = knots * KNOT, np.radians(course)
    value = eotvos(np.radians(latitude), 0.0, speed * np.cos(course), speed * np.sin(course))
    assert value == pytest.approx(published, rel=2e-4)


@given(st.floats(-1.4, 1.4), st.floats(-300.0, 300.0), st.floats(-300.0, 300.0))
def test_eotvos_jacobian_against_finite_differences(latitude, north, east):
    found, step = eotvos_jacobian(latitude, north, east), 1e-2
    for slope, move in zip(found, ((step, 0.0), (0.0, step)), strict=True):
        up, down = (
            eotvos(latitude, 0.0, north + sign * move[0], east + sign * move[1])
            for sign in (1, -1)
        )
        assert slope == pytest.approx(float(up - down) / (2 * step), abs=1e-11)


def test_kernel_equals_array_function():
    for latitude, height in [(-1.2, 0.0), (0.0, 100.0), (0.64, 9000.0)]:
        assert normal_gravity_at(np.sin(latitude), height) == pytest.approx(
            float(normal_gravity(latitude, height)), rel=1e-15
        )
