"""Voyages with map matching where longitudes begin anew, and where meridians converge."""

import math

import numpy as np

from helpers.batches import wavy
from isogal.maps.field_map import FieldMap
from isogal.montecarlo.engine import simulate
from isogal.scenario import Gravimeter, InitialError, MapError, Matcher, Route, Scenario

RADIUS = 6.38e6


def scenario(**route):
    return Scenario(
        gravity={"field": "normal"},
        route=Route(duration=900.0, speed=10.0, **route),
        initial_error=InitialError(position=300.0),
        gravimeter=Gravimeter(quantity="disturbance"),
        map_error=MapError(sigma=1e-5),
        matcher=Matcher(batch_length=15, stride=5, map_sigma=1e-5),
    )


def test_across_the_date_line_as_anywhere_else():
    """To the last digits that a longitude of three radians leaves."""
    side = np.arange(-20e3, 20.1e3, 250.0)
    ends = []
    for longitude in (20.0, 180.0):
        end = (longitude + 180.06) % 360.0 - 180.0
        route = scenario(start=(10.0, longitude - 0.03), end=(10.02, end))
        latitudes = math.radians(10.0) + side / RADIUS
        longitudes = math.radians(longitude - 360.0 * (longitude > 90.0)) + side / RADIUS
        field_map = FieldMap(
            latitudes, longitudes, wavy(side[:, None], side), "m/s²", "disturbance"
        )
        ends.append(simulate(route, [0, 1], field_map))
    elsewhere, across = ends
    assert elsewhere.published.sum() > 20
    np.testing.assert_array_equal(across.published, elsewhere.published)
    np.testing.assert_allclose(across.error, elsewhere.error, rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(across.fix_error, elsewhere.fix_error, rtol=1e-5, atol=1e-3)


def test_eleven_kilometres_from_the_pole():
    """Nine kilometres along the great circle, on which the course turns by half a radian."""
    latitude, longitude = np.radians(np.arange(89.8, 89.96, 0.002)), np.radians(np.arange(-30, 90))
    away = (0.5 * math.pi - latitude[:, None]) * RADIUS
    values = wavy(away * np.cos(longitude), away * np.sin(longitude))
    field_map = FieldMap(latitude, longitude, values, "m/s²", "disturbance")
    found = simulate(scenario(start=(89.9, -5.0), end=(89.9, 70.0)), range(4), field_map)
    assert found.published.sum() > 20
    error, P = found.error[:, -1], found.covariance[:, -1]
    assert np.linalg.norm(error) < 0.5 * np.linalg.norm(found.unaided_error[:, -1])
    nees = np.einsum("ri,ri->", error, np.linalg.solve(P, error[..., None])[..., 0])
    assert 0.86 < nees < 26.1  # all but one in 1,000 of eight degrees of freedom
