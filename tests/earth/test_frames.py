"""ECEF and ENU coordinates: there and back, against PROJ and boule."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer

from isogal.earth.frames import (
    LocalFrame,
    ecef_to_geodetic,
    enu_axes,
    geodetic_to_ecef,
    horizontal_difference,
)

latitudes = st.floats(-np.pi / 2, np.pi / 2)
longitudes = st.floats(-np.pi, np.pi)
heights = st.floats(-12e3, 4e7)


@given(latitudes, longitudes, heights)
def test_geodetic_ecef_and_back(latitude, longitude, height):
    lat, lon, h = ecef_to_geodetic(geodetic_to_ecef(latitude, longitude, height))
    assert lat == pytest.approx(latitude, abs=1e-14)
    assert h == pytest.approx(height, abs=1e-7)
    turn = np.remainder(lon - longitude + np.pi, 2 * np.pi) - np.pi
    assert abs(turn) * np.cos(latitude) < 1e-14


@given(latitudes, longitudes, heights)
def test_geodetic_to_ecef_equals_proj(latitude, longitude, height):
    proj = Transformer.from_pipeline("+proj=cart +ellps=GRS80")
    expected = proj.transform(longitude, latitude, height, radians=True)
    np.testing.assert_allclose(
        geodetic_to_ecef(latitude, longitude, height), expected, rtol=0, atol=1e-7
    )


@given(latitudes, longitudes)
def test_enu_axes_are_a_right_handed_frame_with_up_along_the_normal(latitude, longitude):
    axes = enu_axes(latitude, longitude)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    up = geodetic_to_ecef(latitude, longitude, 1000.0) - geodetic_to_ecef(latitude, longitude, 0.0)
    np.testing.assert_allclose(axes @ up, [0.0, 0.0, 1000.0], atol=1e-8)
    assert axes[0, 2] == 0.0  # east is horizontal


def test_local_frame_points_where_it_says():
    frame = LocalFrame(np.radians(-38.0), np.radians(144.5), 100.0)
    step = 1e-5
    origin = np.radians(-38.0), np.radians(144.5), 100.0
    north = frame.from_geodetic(origin[0] + step, *origin[1:])
    east = frame.from_geodetic(origin[0], origin[1] + step, origin[2])
    up = frame.from_geodetic(*origin[:2], 101.0)
    np.testing.assert_allclose(frame.from_geodetic(*origin), 0.0, atol=1e-9)
    metres = horizontal_difference(origin[0] + step, step, origin[0], 0.0)
    np.testing.assert_allclose(north, [0.0, metres[0], 0.0], atol=2e-3)
    np.testing.assert_allclose(east, [metres[1], 0.0, 0.0], atol=2e-3)
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-9)


@given(latitudes, longitudes, st.floats(-1e3, 2e4))
def test_local_frame_and_back(latitude, longitude, height):
    frame = LocalFrame(np.radians(-38.0), np.radians(144.5), 100.0)
    enu = frame.from_geodetic(latitude, longitude, height)
    back = frame.from_geodetic(*frame.to_geodetic(enu))
    np.testing.assert_allclose(back, enu, atol=1e-7)
    assert frame.to_geodetic(enu)[2] == pytest.approx(height, abs=1e-7)


def test_rotation_from_another_point():
    frame = LocalFrame(np.radians(-38.0), np.radians(144.5))
    there = np.radians(-35.0), np.radians(150.0)
    expected = frame.from_geodetic(*there, 1.0) - frame.from_geodetic(*there, 0.0)
    np.testing.assert_allclose(frame.rotation_from(*there) @ [0.0, 0.0, 1.0], expected, atol=1e-8)


@pytest.mark.parametrize("longitude", [0.0, 179.9999, -180.0, 359.9999])
def test_horizontal_difference_crosses_the_date_line(longitude):
    step = 0.001
    difference = horizontal_difference(
        np.radians(-30.0),
        np.radians(np.remainder(longitude + step, 360.0)),
        np.radians(-30.001),
        np.radians(longitude),
    )
    np.testing.assert_allclose(difference, [110.85, 96.49], atol=0.02)


@pytest.mark.parametrize("place", [(-0.6, 2.4, 100.0), (1.5, -3.1, -20.0), (0.0, 0.0, 1e4)])
def test_one_point_is_where_it_is_among_others(place):
    many = geodetic_to_ecef(*(np.array([0.1, number]) for number in place))
    np.testing.assert_allclose(geodetic_to_ecef(*place), many[1], rtol=0, atol=1e-8)
