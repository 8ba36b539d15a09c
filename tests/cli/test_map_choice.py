"""Which map: the same options for `isogal map` and `isogal match`."""

import pytest

from helpers.command_line import refusal
from isogal.cli.map_choice import MapChoice, MapOption
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.formats.netcdf_writing import write_netcdf


@pytest.fixture
def file(small_map, tmp_path):
    """A map, and a track beside it."""
    write_netcdf(small_map, tmp_path / "map.nc")
    write_netcdf(small_map, tmp_path / "map.grid")
    (tmp_path / "track.csv").write_text(
        "time,latitude,longitude,value\n0,-36.8,145,0\n1,-36.7,145,0\n2,-36.6,145,0\n"
    )
    return tmp_path / "map.nc"


@pytest.mark.parametrize(
    ("name", "words", "message"),
    [
        ("none.nc", (), "none.nc: no such file or folder"),
        ("map.nc", ("--variable", "nix"), "has no grid 'nix'"),
        ("map.nc", ("--quantity", "nix"), "unknown quantity 'nix'; known: gravity, disturbance, "),
        ("map.nc", ("--format", "nix"), "unknown map format 'nix'"),
        ("map.nc", ("--format", "xyz"), "map.nc"),
        ("map.nc", ("--crs", "EPSG:4326"), "crs can only be given for geotiff"),
        ("map.grid", (), "not a known map format by its name"),
    ],
)
def test_what_cannot_be_read_is_refused_alike(file, name, words, message):
    source, track = file.with_name(name), file.with_name("track.csv")
    assert message in refusal("map", "info", source, *words)
    assert message in refusal("match", "--map", source, "--track", track, *words)


def test_a_format_that_the_name_does_not_say(file, small_map):
    for group in (MapChoice, MapOption):
        found = group(str(file.with_name("map.grid")), format_name="netcdf").load(None)
        assert found.values.shape == small_map.values.shape


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({}, "the synthetic map has no end: give --window, --route or --scenario"),
        ({"variable": "xi"}, "--variable: the synthetic map has height, ga and dg, not 'xi'"),
        ({"unit": "mGal"}, "--unit mGal: cannot be given for the synthetic map"),
        ({"format_name": "xyz"}, "--format xyz: cannot be given for the synthetic map"),
    ],
)
def test_what_the_synthetic_map_does_not_have_is_refused(choice, message):
    window = Window(-0.65, -0.649, 2.5, 2.501) if choice else None
    with pytest.raises(InputError, match=message):
        MapChoice("synthetic", **choice).load(window)


@pytest.mark.parametrize(
    ("choice", "quantity"),
    [
        ({}, "disturbance"),
        ({"variable": "ga"}, "gravity"),
        ({"variable": "ga", "quantity": "height"}, "height"),
    ],
)
def test_quantity_of_the_synthetic_map(monkeypatch, choice, quantity):
    monkeypatch.setattr("isogal.cli.map_choice.make_synthetic", lambda name, window: name)
    window = Window(-0.65, -0.649, 2.5, 2.501)
    assert MapChoice("synthetic", **choice).load(window, measured="disturbance") == quantity
