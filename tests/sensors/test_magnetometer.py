"""The main field: against published values of the IGRF, and between the points at which it is
evaluated."""

import numpy as np
import pytest

from isogal.sensors.magnetometer import (
    MagneticReduction,
    MainField,
    decimal_year,
    intensity,
    is_absolute,
)
from isogal.sensors.reduction import State

LATITUDE, LONGITUDE = np.radians([55.5, 56.4]), np.radians([-5.0, -3.0])


@pytest.fixture(scope="module")
def main_field():
    return MainField(LATITUDE, LONGITUDE, 300.0, 2025.0)


def test_interpolation_agrees_with_the_model(main_field):
    random = np.random.default_rng(1)
    latitude, longitude = random.uniform(54.0, 58.0, 300), random.uniform(-7.0, -1.0, 300)
    exact = intensity(latitude, longitude, 300.0, 2025.0)
    np.testing.assert_allclose(
        main_field.value(np.radians(latitude), np.radians(longitude), 300.0), exact, atol=0.02
    )


@pytest.mark.parametrize(
    ("latitude", "longitude"),
    [
        (np.radians([-10.0, 10.0]), np.radians([179.0, -179.0])),
        (np.radians([0.0, 0.0]), np.linspace(-3.1, 3.1, 50)),
        (np.radians([86.0, 86.5]), np.radians([0.0, 40.0])),
    ],
    ids=["date line", "round the Earth", "near a pole"],
)
def test_anywhere_on_earth(latitude, longitude):
    latitude = np.resize(latitude, longitude.size)
    field = MainField(latitude, longitude, 0.0, 2025.0)
    exact = intensity(np.degrees(latitude), np.degrees(longitude), 0.0, 2025.0)
    np.testing.assert_allclose(field.value(latitude, longitude, 0.0), exact, atol=0.1)


def test_the_anomaly_is_the_field_less_the_model(main_field):
    reduction = MagneticReduction(main_field)
    at = State(np.radians(56.0), np.radians(-4.0), 300.0, 30.0, 0.0)
    total = float(intensity(56.0, -4.0, 300.0, 2025.0)) + 123.0
    assert reduction.reduce(total, at) == pytest.approx(123.0, abs=0.02)
    away = at._replace(latitude=np.radians(30.0))
    assert np.isnan(reduction.reduce(total, away))  # nobody asked about that part of the Earth


def test_the_date_of_a_reading_counts_where_its_time_is_absolute(main_field):
    # 2021-07-02 12:00 UTC is the middle of 2021
    assert decimal_year(1_625_227_200.0) == pytest.approx(2021.5)
    assert (is_absolute(1_625_227_200.0), is_absolute([12_960.0, 1_625_227_200.0])) == (
        True,
        False,
    )
    at = State(np.radians(56.0), np.radians(-4.0), 300.0, 30.0, 0.0)
    reduction = MagneticReduction(main_field)
    for time, year in ((1_625_227_200.0, 2021.5), (1_639_000_000.0, 2021.9366)):
        exact = float(intensity(56.0, -4.0, 300.0, year))
        assert reduction.dated(time).reduce(exact, at) == pytest.approx(0.0, abs=0.05)
        assert abs(float(reduction.reduce(exact, at))) > 5.0  # by the epoch, 2025.0
    assert reduction.dated(12_960.0) is reduction
    # beyond the model the field is taken as at its end
    assert decimal_year(4.0e9) == 2030.0
    years = [2021.5, 2021.9, 2030.0]
    several = main_field.value(np.radians([56.0] * 3), np.radians([-4.0] * 3), 300.0, years)
    expected = [float(intensity(56.0, -4.0, 300.0, year)) for year in years]
    np.testing.assert_allclose(several, expected, atol=0.05)
