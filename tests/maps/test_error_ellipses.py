"""Errors that hold together further in one direction than in another."""

from dataclasses import replace

import netCDF4
import numpy as np
import pytest

from isogal.errors import InputError
from isogal.maps.error_ellipses import axes_of, ellipses_of, impossible, mean_length
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map

LONGEST, SHORTEST = np.array([4e3, 2e3, 900.0]), np.array([1e3, 500.0, 800.0])
AZIMUTH = np.radians([30.0, 100.0, 170.0])


def test_axes_and_matrix_are_the_same_thing():
    ellipses = ellipses_of(LONGEST, SHORTEST, AZIMUTH)
    for found, expected in zip(axes_of(ellipses), (LONGEST, SHORTEST, AZIMUTH), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    # to the north-east by 30 deg: a point one length away on the long axis
    c, s = np.cos(AZIMUTH[0]), np.sin(AZIMUTH[0])
    matrix = ellipses[0][[0, 1, 1, 2]].reshape(2, 2)
    there = 4e3 * np.array([c, s])
    assert there @ np.linalg.solve(matrix, there) == pytest.approx(1.0)
    assert not impossible(ellipses).any()
    assert impossible(np.array([[1.0, 2.0, 1.0], [-1.0, 0.0, 1.0]])).all()
    assert not impossible(np.full(3, np.nan))


def test_a_map_keeps_them_in_windows_and_files(small_map, tmp_path):
    count = small_map.values.size
    longest = np.linspace(2e3, 6e3, count).reshape(small_map.shape)
    azimuth = np.linspace(0.1, 3.0, count).reshape(small_map.shape)
    ellipses = ellipses_of(longest, 0.25 * longest, azimuth)
    told = replace(small_map, error_ellipses=ellipses, correlation_length=700.0)
    here = told.latitude[5], told.longitude[7]
    np.testing.assert_allclose(told.error_ellipse_at(*here), ellipses[5, 7])
    part = told.window(here[0], here[0], here[1], here[1])
    assert part.error_ellipses.shape == (*part.shape, 3)
    np.testing.assert_allclose(part.error_ellipse_at(*here), ellipses[5, 7])
    thin = told.thinned(2, 3)
    np.testing.assert_array_equal(thin.error_ellipses, ellipses[::2, ::3])
    assert np.isnan(small_map.error_ellipse_at(*here)).all()
    write_netcdf(told, tmp_path / "map.nc")
    again = load_map(tmp_path / "map.nc", small_map.quantity)
    np.testing.assert_allclose(again.error_ellipses, ellipses, rtol=1e-5, atol=20.0)
    for wrong in (ellipses[1:], -ellipses):
        with pytest.raises(InputError, match=r"error_ellipses has shape|lengths must be > 0 m"):
            replace(small_map, error_ellipses=wrong)


def test_one_length_at_each_node_is_that_of_all_directions(small_map, tmp_path):
    write_netcdf(small_map, tmp_path / "map.nc", "dg")
    length = np.linspace(2e3, 6e3, small_map.values.size).reshape(small_map.shape)
    with netCDF4.Dataset(tmp_path / "map.nc", "a") as dataset:
        dataset.createVariable("dg_error_length", "f8", ("lat", "lon"))[:] = length
    found = load_map(tmp_path / "map.nc", "dg").error_ellipses
    np.testing.assert_allclose(mean_length(found), length)
    np.testing.assert_allclose(found[..., 1], 0.0, atol=1e-6)
