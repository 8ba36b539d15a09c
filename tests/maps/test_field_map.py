"""FieldMap: validation, metres, windows."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.refusals import refusal
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap


def wave_map(lat_deg=(-38.0, -36.0), lon_deg=(144.0, 147.0), n=201, m=301, **more):
    lat, lon = np.radians(np.linspace(*lat_deg, n)), np.radians(np.linspace(*lon_deg, m))
    values = 1e-4 * np.sin(200 * lat)[:, None] * np.cos(150 * lon)[None, :]
    return FieldMap(lat, lon, values, "m/s²", "disturbance", **more)


def test_gradient_is_per_metre_to_north_and_east():
    lat, lon = np.radians(-37.1234), np.radians(145.4321)
    north, east = metres_per_radian(lat)
    _, *found = wave_map().value_and_gradient(lat, lon)
    y, x = 200 * lat, 150 * lon
    slopes = 0.02 * math.cos(y) * math.cos(x) / north, -0.015 * math.sin(y) * math.sin(x) / east
    assert found == pytest.approx(slopes, rel=1e-3)


def test_shapes_broadcast():
    sigma = np.broadcast_to(np.linspace(1e-5, 2e-5, 201)[:, None], (201, 301))
    field_map = wave_map(sigma=sigma)
    lat, lon = np.radians([[-37.0], [-36.5]]), np.radians([145.0, 145.5, 146.0])
    assert field_map.value(lat, lon).shape == (2, 3)
    assert all(x.shape == (2, 3) for x in field_map.value_and_gradient(lat, lon))
    assert np.ndim(field_map.value(-0.65, 2.53)) == 0
    assert field_map.covers(lat, lon).all()
    assert not field_map.covers(np.radians(-39.0), np.radians(145.0))
    assert field_map.cell_size_m(lat[0, 0]) == pytest.approx((1110, 890), rel=0.01)
    linear = np.broadcast_to([[1.5e-5], [1.75e-5]], (2, 3))
    np.testing.assert_allclose(field_map.sigma_at(lat, lon), linear)
    assert (wave_map().sigma_at(lat, lon) == np.zeros((2, 3))).all()


def test_masked_nodes_and_points_have_no_value():
    """As netCDF4 gives them: what lies beneath the mask is not a value."""
    lat, lon = np.radians(np.linspace(-38.0, -36.0, 21)), np.radians(np.linspace(144.0, 147.0, 31))
    values = np.ma.masked_less(np.where(lon > lon[15], -9999.0, 1e-4 * np.ones((21, 31))), -1.0)
    field_map = FieldMap(lat, lon, values, "m/s²", "disturbance")
    assert field_map.covers(lat[10], lon[[5, 25]]).tolist() == [True, False]
    points = np.ma.array(lon[[5, 6]], mask=[False, True])
    assert field_map.covers(lat[10], points).tolist() == [True, False]
    with pytest.raises(InputError, match="values must be numbers, is of type complex128"):
        FieldMap(lat, lon, 1j * np.ones((21, 31)), "m/s²", "disturbance")


@settings(max_examples=40, deadline=None)
@given(
    st.floats(-37.9, -36.2),
    st.floats(144.1, 146.8),
    st.floats(0.01, 0.5),
    st.floats(0.01, 0.5),
    st.sampled_from([-360.0, 0.0, 360.0]),
)
def test_a_window_has_the_same_values(south, west, height, width, turn):
    field_map = wave_map()
    north, east = min(south + height, -36.1), min(west + width, 146.9)
    part = field_map.window(*np.radians([south, north, west + turn, east + turn]))
    lat, lon = np.radians(np.linspace(south, north, 5)), np.radians(np.linspace(west, east, 5))
    whole = field_map.value(lat, lon)
    np.testing.assert_allclose(part.value(lat, lon), whole, rtol=0, atol=1e-16)
    assert np.isfinite(whole).all() and part.values.size <= field_map.values.size


def test_a_window_across_the_seam_of_a_global_map():
    lat, lon = np.radians(np.linspace(-89.5, 89.5, 180)), np.radians(np.arange(0.0, 360.0))
    values = 1e-4 * np.cos(lat)[:, None] * np.cos(lon)[None, :]
    field_map = FieldMap(lat, lon, values, "m/s²", "disturbance")
    part = field_map.window(*np.radians([-5.0, 5.0, -4.0, 4.0]))
    assert part.values.shape[1] < 20
    assert np.isnan(part.value(0.01, np.radians(20.0)))
    first = field_map.window(*np.radians([-5.0, 5.0, 1.0, 3.0]))
    across = field_map.window(*np.radians([-5.0, 5.0, 175.0, -175.0]))
    places = [(part, d) for d in (-3.9, 0.0, 3.9, 356.5)] + [(first, 1.0), (across, -179.9)]
    for one, degrees in places:
        expected = pytest.approx(field_map.value(0.01, np.radians(degrees)), abs=1e-16)
        assert one.value(0.01, np.radians(degrees)) == expected


def test_a_repeated_meridian_is_dropped():
    lat, lon = np.radians(np.linspace(-10.0, 10.0, 21)), np.radians(np.arange(-180.0, 181.0))
    values = 1e-4 * np.broadcast_to(np.cos(lon), (21, 361))
    field_map = FieldMap(lat, lon, values, "m/s²", "disturbance")
    assert field_map.longitude.size == 360
    assert field_map.value(0.0, math.pi) == pytest.approx(-1e-4, abs=1e-7)


@pytest.mark.parametrize("unknown", [math.nan, math.inf])
def test_an_error_that_is_said_of_no_node_is_not_said(unknown):
    axis = np.radians(np.arange(6.0))
    field_map = FieldMap(axis, axis, np.eye(6), "m", "height", sigma=np.full((6, 6), unknown))
    assert field_map.sigma == 0.0
    assert not field_map.states_error


@pytest.mark.parametrize(
    "change,words",
    [
        ({"latitude": np.radians([0.0, 1.0, 2.5, 3.0, 4.0])}, "regularly spaced"),
        ({"latitude": np.radians([4.0, 3.0, 2.0, 1.0, 0.0])}, "increase"),
        ({"latitude": np.array([0.0, 1.0, 2.0, 3.0, 4.0])}, "-90 to 90"),
        ({"latitude": np.radians([0.0, 1.0, np.nan, 3.0, 4.0])}, "node 2 is at nan deg"),
        ({"longitude": np.radians([0.0, 1.0, 2.0])}, "at least 4"),
        ({"longitude": np.linspace(0.0, 12.0, 6)}, "more than once"),
        ({"values": np.zeros((6, 5))}, "shape"),
        ({"values": np.full((5, 6), np.nan)}, "all missing"),
        ({"sigma": -1.0}, "sigma"),
        ({"sigma": np.zeros((2, 2))}, "sigma has shape"),
        ({"correlation_length": 0.0}, "correlation_length"),
        ({"quantisation": math.nan}, "quantisation"),
        ({"unresolved": math.nan}, "unresolved"),
    ],
)
def test_bad_maps_are_refused_in_one_line(change, words):
    good = {
        "latitude": np.radians(np.arange(5.0)),
        "longitude": np.radians(np.arange(6.0)),
        "values": np.zeros((5, 6)),
        "unit": "m",
        "quantity": "height",
    }
    FieldMap(**good)
    with refusal(words):
        FieldMap(**{**good, **change})


def test_windows_that_miss_the_map_are_refused():
    for away in (10.0, 11.0, 145.0, 146.0), (-37.0, -36.5, 20.0, 21.0):
        with pytest.raises(InputError, match="has nothing at"):
            wave_map().window(*np.radians(away))
