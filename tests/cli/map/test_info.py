"""What `isogal map info` says about a map, and about fixes along a route."""

import json
from dataclasses import replace

import numpy as np
import pytest

from helpers.command_line import answer
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
        "minimum": np.nanmin(values),
        "maximum": np.nanmax(values),
        "mean": np.nanmean(values),
        "standard_deviation": np.nanstd(values),
        "missing": 15 / 480,
        "south": -37.0,
        "east": 145.65,
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    text = answer("map", "info", path)
    assert "mGal" in text
    assert "disturbance" in text


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


def test_the_options_of_the_errors_count(file):
    plain, wrong, longer, offset = (
        described(file, *ROUTE, *words)["route"]["stretches"][0]["sigma_worst"]
        for words in (
            (),
            ("--map-sigma", 1e-5),
            ("--map-sigma", 1e-5, "--map-correlation-length", 500),
            ("--bias-sigma", 1e-4),
        )
    )
    assert plain < min(wrong, longer, offset)
    assert wrong != longer


def test_the_synthetic_map_is_shown_along_a_route():
    found = described("synthetic", "--route", "-37.1,145.1 -37.05,145.2", "--margin", 5)
    assert found["quantity"] == "gravity"
    assert found["route"]["length_km"] == pytest.approx(10.5, abs=0.5)


def test_a_large_map_is_described_in_tiles(file, tmp_path, monkeypatch):
    route = (*ROUTE, "--margin", 10)
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
