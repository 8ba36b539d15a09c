"""What `isogal map info`, `variability` and `navigability` say and draw of a map."""

import json
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
import rasterio

from helpers.batches import field_map_of, wavy
from helpers.command_line import answer, refusal
from isogal.maps import tiled_map
from isogal.maps.formats.netcdf_writing import write_netcdf

ROUTE = ("--route", "-36.9,144.7 -36.2,145.4")


def described(*words):
    return json.loads(answer("map", "info", *words, "--json"))


def test_description_of_a_map(small_map, tmp_path):
    values = small_map.values.copy()
    values[3:6, 4:9] = np.nan
    path = tmp_path / "holed.nc"
    write_netcdf(replace(small_map, values=values), path)
    found = described(path)
    assert (found["quantity"], found["unit"], found["nodes"]) == ("disturbance", "m/s²", [20, 24])
    expected = {
        "maximum": np.nanmax(values),
        "mean": np.nanmean(values),
        "standard_deviation": np.nanstd(values),
        "missing": 15 / 480,
        "east": 145.65,
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert "mGal" in answer("map", "info", path)


def test_a_route_adds_the_expected_accuracy_of_fixes(file, tmp_path):
    picture = tmp_path / "new" / "picture.png"
    sensor = ("--set", "gravimeter.sigma=1e-6")
    route = described(file, *ROUTE, *sensor, "--figure", picture)["route"]
    assert len(route["stretches"]) == round(route["length_km"] / 5.0)
    assert all(0.0 < part["sigma_best"] <= part["sigma_worst"] for part in route["stretches"])
    assert picture.read_bytes().startswith(b"\x89PNG")
    worse = described(file, *ROUTE, "--sensor-sigma", 1e-5)["route"]
    assert worse["stretches"][0]["sigma_best"] > 5.0 * route["stretches"][0]["sigma_best"]
    text = answer("map", "info", file, *ROUTE, "--figure", picture)
    assert "worst (m)" in text
    assert text.endswith(f"{picture}\n")


def test_the_scenario_counts_as_in_a_run(file):
    """Its map error, the instrument's true noise, and the height of the flight."""

    def worst(*changes):
        words = [word for change in changes for word in ("--set", change)]
        route = described(file, "--route", "-36.7,144.9 -36.4,145.2", *words)["route"]
        return route["stretches"][0]["sigma_worst"]

    exact = worst("map_error.sigma=0")
    wrong = worst("map_error.sigma=1e-4")
    assert wrong > 1.1 * exact
    assert worst("map_error.sigma=1e-4", "map_error.correlation_length=500") != wrong
    assert worst("truth.gravimeter.sigma=3x") == pytest.approx(3.0 * exact, rel=1e-3)
    assert worst("route.height=1500") > 1.1 * exact
    as_it_is = worst("route.height=1500", "map.continuation=none")
    assert as_it_is == pytest.approx(exact, rel=0.01)
    message = refusal("map", "info", file, *ROUTE, "--set", "route.height=4000")
    assert message.endswith("; --set map.continuation=none takes it as it is\n")
    assert "at route.height 100 m" in " ".join(answer("map", "info", file, *ROUTE).split())


def test_the_synthetic_map_is_shown_along_a_route():
    found = described("synthetic", "--route", "-37.1,145.1 -37.05,145.2", "--margin", 5)
    assert found["quantity"] == "gravity"
    assert found["route"]["length_km"] == pytest.approx(10.5, abs=0.5)


def test_a_large_map_is_described_in_tiles(file, tmp_path, monkeypatch):
    route = (*ROUTE, "--margin", 10, "--set", "route.height=0")
    whole = described(file, *route)
    monkeypatch.setattr(tiled_map, "WHOLE_CELLS", 100)
    monkeypatch.setattr(tiled_map, "TILE_CELLS", 8)
    picture = tmp_path / "picture.png"
    tiled = described(file, *route, "--figure", picture)
    for one, other in zip(tiled["route"]["stretches"], whole["route"]["stretches"], strict=True):
        assert one == pytest.approx(other, rel=1e-6)
    assert tiled["mean"] == pytest.approx(whole["mean"], abs=0.2 * whole["standard_deviation"])
    assert whole["minimum"] <= tiled["minimum"] < tiled["maximum"] <= whole["maximum"]
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_variability_along_a_route(file, tmp_path):
    picture = tmp_path / "picture.png"
    words = ("map", "variability", file, *ROUTE)
    found = json.loads(answer(*words, "--samples", 50, "--figure", picture, "--json"))
    assert (found["samples"], found["points"], found["half_width"]) == (50, 9, 2000.0)
    assert len(found["places"]) > 300
    assert found["places"][0]["latitude"] == pytest.approx(-36.9)
    assert picture.read_bytes().startswith(b"\x89PNG")
    text = answer(*words, "--figure", picture)
    assert "normalised" in text
    assert text.endswith(f"{picture}\n")


def test_where_the_map_ends_the_variability_is_missing(file):
    """More than half of a template 400 km wide lies off the map."""
    words = ("map", "variability", file, *ROUTE, "--half-width", 200_000)
    places = json.loads(answer(*words, "--json"))["places"]
    assert all(place["variability"] is None for place in places)
    assert "nan" not in answer(*words)


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
