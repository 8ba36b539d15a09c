"""What `isogal plan` writes and prints."""

import json
import re

import pytest
import yaml

from helpers.batches import field_map_of, wavy
from helpers.command_line import answer, refusal
from isogal.maps.formats.netcdf_writing import write_netcdf

ENDS = ("--from", "-36.5,146.85", "--to", "-36.5,147.15", "--detour", "0.05")


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "rough.nc"
    write_netcdf(field_map_of(wavy, half=30e3, step=1000.0), path)
    return path


def test_the_files_of_a_plan(rough, tmp_path):
    words = ("--out", tmp_path / "a.yaml", "--out", tmp_path / "a.geojson", "--json")
    found = json.loads(
        answer("plan", "--map", rough, *ENDS, *words, "--path", tmp_path / "p.yaml")
    )
    assert found["error_on_arrival_m"] <= found["straight"]["error_on_arrival_m"]
    assert len(found["files"]) == 3
    route = yaml.safe_load((tmp_path / "a.yaml").read_text())["route"]
    assert len(route["waypoints"]) == len(found["waypoints"])
    feature = json.loads((tmp_path / "a.geojson").read_text())["features"][0]
    assert feature["properties"]["error_on_arrival_m"] == found["error_on_arrival_m"]
    arrival = pytest.approx(found["error_on_arrival_m"], abs=0.01)
    assert feature["properties"]["expected_error_m"][-1] == arrival


def test_what_is_printed(rough, tmp_path):
    straight = answer("plan", "--map", rough, *ENDS)
    assert re.search(r"km with \d+ waypoints, expected error on\s+arrival \d+ m", straight)
    assert "straight: 26.9 km" in straight
    square = [[147.0, -36.52], [147.01, -36.52], [147.01, -36.48], [147.0, -36.48]]
    area = {"type": "Polygon", "coordinates": [[*square, square[0]]]}
    (tmp_path / "no.geojson").write_text(json.dumps(area))
    around = answer("plan", "--map", rough, *ENDS, "--no-go", tmp_path / "no.geojson")
    assert "the straight way is not free" in around


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--from", "-36.5,146.85", "--to", "-10,147.15"), "no value at -10.0000, 147.1500 deg"),
        (("--from", "here", "--to", "-36,147"), "must be LATITUDE,LONGITUDE"),
        (("--from", "-36.5,147", "--to", "-36.5,147"), "the same place"),
        ((*ENDS, "--detour", "-1"), "must be > 0"),
        ((*ENDS, "--detour", "1e9"), "less than or equal to 1"),
        ((*ENDS, "--out", "a.txt"), "must end in .yaml or .yml or .geojson"),
        ((*ENDS, "--no-go", "none.geojson"), "cannot be read"),
    ],
)
def test_bad_input_is_one_line(rough, words, message):
    assert message in refusal("plan", "--map", rough, *words)
