"""Readings as measurements by themselves."""

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.navigators import ROUTE, fly
from helpers.route_maps import field
from isogal.fusion.measurements.map_reading import MapReading, linear_map
from isogal.maps.field_map import FieldMap

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 60.0}))
WAVY = field_map_of(wavy)


def places(field_map: FieldMap, count: int) -> tuple[np.ndarray, np.ndarray]:
    middle = [float(np.mean(axis)) for axis in (field_map.latitude, field_map.longitude)]
    shift = np.linspace(-1e-4, 1e-4, count)
    return middle[0] + shift, middle[1] - shift


def test_where_the_place_is_known_it_is_the_map_and_its_gradient() -> None:
    latitude, longitude = places(WAVY, 7)
    known = np.tile(np.eye(2) * 1e-2, (7, 1, 1))
    found, slope, left = linear_map(WAVY, latitude, longitude, known)
    value, north, east = WAVY.value_and_gradient(latitude, longitude)
    np.testing.assert_allclose(found, value, atol=1e-10)
    np.testing.assert_allclose(slope, np.stack([north, east], -1), rtol=1e-3, atol=1e-12)
    assert left.max() < 1e-16


def test_where_it_is_not_it_is_the_regression_over_all_places() -> None:
    """Of a map that is a parabola to the north: exact moments."""
    bend = 1e-11
    parabola = field(lambda n, e: bend * n**2 + 2e-9 * e)
    latitude, longitude = places(parabola, 3)
    P = np.tile(np.array([[300.0**2, 1e4], [1e4, 200.0**2]]), (3, 1, 1))
    found, slope, left = linear_map(parabola, latitude, longitude, P)
    value, north, east = parabola.value_and_gradient(latitude, longitude)
    np.testing.assert_allclose(found, value + bend * 300.0**2, rtol=1e-2, atol=1e-8)
    np.testing.assert_allclose(slope[:, 0], north, atol=2e-10)
    np.testing.assert_allclose(slope[:, 1], east, rtol=1e-2)
    np.testing.assert_allclose(left, 2.0 * (bend * 300.0**2) ** 2, rtol=0.02)


def test_off_the_map_there_is_no_number() -> None:
    latitude, longitude = places(WAVY, 2)
    found = linear_map(WAVY, latitude + 0.1, longitude, np.tile(np.eye(2), (2, 1, 1)))
    assert np.isnan(found[0]).all()


def test_a_reading_moves_the_navigator_along_the_gradient() -> None:
    """The residual is that of a navigator that is 100 m north of its reference, which is true."""
    state = FLIGHT.start.copy()
    state.covariance[:2, :2] = np.eye(2) * 300.0**2
    reference = np.array([*state.position, *state.velocity[:2]])
    reference[0] -= 100.0 / 6.36e6
    reading = MapReading(reference, 0.0, 1e-7 * np.eye(5)[0], 1e-14, contents=())
    result = reading.update(state, FLIGHT.model)
    assert result.used
    apart = (state.position[0] - reference[0]) * 6.36e6
    assert apart == pytest.approx(0.0, abs=1.0)
    assert state.covariance[0, 0] == pytest.approx(1.0, rel=0.01)  # sqrt(1e-14) / 1e-7
    assert state.covariance[1, 1] == pytest.approx(300.0**2)
