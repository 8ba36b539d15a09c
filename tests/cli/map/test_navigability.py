"""What `isogal map navigability` writes and prints."""

import json

import netCDF4
import numpy as np
import pytest
import rasterio

from helpers.batches import field_map_of, wavy
from helpers.command_line import answer
from isogal.maps.formats.netcdf_writing import write_netcdf


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    path = tmp_path_factory.mktemp("navigability") / "rough.nc"
    write_netcdf(field_map_of(wavy, half=9e3, step=500.0), path)
    return path


def test_files_hold_the_same_grids(rough, tmp_path):
    words = ("--headings", 4, "--out", tmp_path / "a.nc", "--out", tmp_path / "a.tif")
    text = answer("map", "navigability", rough, *words, "--figure", tmp_path / "a.png")
    assert "error_worst (m)" in text
    assert (tmp_path / "a.png").stat().st_size > 20_000
    with netCDF4.Dataset(tmp_path / "a.nc") as grids, rasterio.open(tmp_path / "a.tif") as bands:
        assert bands.descriptions[1] == "error_mean"
        mean = np.ma.filled(grids["error_mean"][:], np.nan)
        np.testing.assert_array_equal(bands.read(2)[::-1], mean)
        latitude, longitude = float(grids["lat"][30]), float(grids["lon"][20])
        assert bands.index(longitude, latitude) == (mean.shape[0] - 1 - 30, 20)
        assert grids["error"].shape == (4, *mean.shape)
    found = json.loads(answer("map", "navigability", rough, "--headings", 1, "--json"))
    assert found["headings"] == 1
    assert found["error_best"] == found["error_worst"]


def test_a_window_is_enough(rough):
    words = ("--window", -36.55, -36.45, 146.95, 147.05, "--json", "--headings", 2)
    found = json.loads(answer("map", "navigability", rough, *words))
    assert max(found["nodes"]) < 40
