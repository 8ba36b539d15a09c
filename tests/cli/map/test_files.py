"""What `isogal map convert`, `synth`, `continue`, `fetch` and `grid` write and print."""

import json
from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of
from helpers.command_line import answer, refusal
from helpers.mirror import serving
from helpers.surveys import drawn, few_places, flight_lines
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map

WINDOW = ("--window", -37.1, -37.0, 145.0, 145.1)


def test_a_window_becomes_a_file(tmp_path):
    out = tmp_path / "synthetic.nc"
    words = ("map", "synth", *WINDOW, "--quantity", "disturbance", "--out", out)
    assert answer(*words).endswith(f"{out}\n")
    field_map = load_map(out)
    assert (field_map.quantity, field_map.quantisation) == ("disturbance", 1e-6)
    assert json.loads(answer(*words, "--json"))["file"] == str(out)


def test_a_part_with_its_error(tmp_path):
    first, back = tmp_path / "first.nc", tmp_path / "back.nc"
    answer("map", "convert", "synthetic", first, "--variable", "dg", *WINDOW)
    inner = ("--window", -37.08, -37.02, 145.02, 145.08)
    error = ("--sigma", 3e-5, "--correlation-length", 4000)
    found = json.loads(answer("map", "convert", first, back, *inner, *error, "--json"))
    assert found["file"] == str(back)
    before, after = load_map(first), load_map(back)
    assert (after.sigma, after.correlation_length) == (3e-5, 4000.0)
    at = np.radians([-37.05, -37.03]), np.radians([145.05, 145.04])
    np.testing.assert_allclose(after.value(*at), before.value(*at), rtol=0, atol=1e-12)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A map on a level, another of the ground's height, and one that does not say its height."""
    folder = tmp_path_factory.mktemp("continue")
    wave = field_map_of(
        lambda n, e: 1e-4 * np.sin(2.0 * np.pi * n / 10e3) + 0.0 * e, half=30e3, step=1000.0
    )
    hills = field_map_of(
        lambda n, e: 200.0 + 200.0 * np.sin(e / 5e3) + 0.0 * n, half=30e3, step=1000.0
    )
    write_netcdf(replace(wave, height=100.0, quantisation=1e-6), folder / "level.nc")
    write_netcdf(wave, folder / "unsaid.nc")
    write_netcdf(replace(hills, unit="m", quantity="height"), folder / "hills.nc")
    return folder


def test_from_the_level_that_the_file_says(folder, tmp_path):
    out = tmp_path / "high.nc"
    found = json.loads(
        answer("map", "continue", folder / "level.nc", out, "--height", 1100, "--json")
    )
    high = load_map(out)
    assert (found["height"], high.height, found["file"]) == (1100.0, 1100.0, str(out))
    assert 0.0 < high.sigma == found["sigma"] < 1e-7
    assert not high.states_error
    answer("map", "convert", out, tmp_path / "stated.nc", "--sigma", "2mGal")
    assert load_map(tmp_path / "stated.nc").usual_sigma == pytest.approx(2e-5)
    low = load_map(folder / "level.nc")
    crest = float(low.latitude.mean()) + 2500.0 / 6.36e6, float(low.longitude.mean())
    back = tmp_path / "back.nc"
    words = ("--height", 100, "--downward-cutoff", 4, "--edge", 5)
    assert answer("map", "continue", out, back, *words).endswith(f"{back}\n")
    assert load_map(back).value(*crest) == pytest.approx(low.value(*crest), rel=0.02)


def test_from_the_ground(folder, tmp_path):
    out = tmp_path / "high.nc"
    words = ("--height", 1000, "--terrain", folder / "hills.nc")
    window = ("--window", -36.65, -36.35, 146.8, 147.2)
    answer("map", "continue", folder / "unsaid.nc", out, *words, *window)
    high = load_map(out)
    assert high.height == 1000.0
    assert high.sigma.shape == high.values.shape


FAR = ("--route", "-38,144 -38,146")


@pytest.fixture
def mirror(monkeypatch):
    """Holds the tiles of one place: 4 bytes a cell of gravity, 2 of its disturbance."""
    monkeypatch.setattr("isogal.maps.ggmplus.fetch.CELLS", 100)
    with serving({"S40E145.ga": bytes(40_000), "S40E145.dg": bytes(20_000)}) as server:
        yield server.url


def test_tiles_of_a_variable_or_else_of_the_scenarios_field_are_fetched_once(mirror, tmp_path):
    words = ("map", "fetch", "--base-url", mirror, "--out", tmp_path / "g", "--variable", "dg")
    found = json.loads(answer(*words, *FAR, "--json"))
    assert (found["downloaded"], found["absent"]) == (["S40E145.dg"], ["S40E140.dg"])
    text = answer(*words, *FAR)
    assert "S40E145.dg  there already" in text
    assert "S40E140.dg  not on the server" in text
    assert text.endswith(f"map.source: {tmp_path / 'g'}\n")
    words = ("map", "fetch", "--base-url", mirror, "--out", tmp_path / "g", *FAR)
    assert "S40E145.ga  fetched, trusted on first use" in answer(*words)


__all__ = ["few_places"]


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """Lines to the east and ties across them."""
    lines, number = flight_lines(6, 1500.0, 400.0, 6e3)
    ties, other = flight_lines(3, 3000.0, 400.0, 5e3)
    places = np.concatenate([lines, ties[:, ::-1] + 55.0])
    number = np.concatenate([number, 100 + other])
    _, value = drawn(places, seed=1)
    path = tmp_path_factory.mktemp("grid") / "survey.csv"
    rows = [
        f"{-36.5 + y / 111e3:.7f},{147.0 + x / 89.5e3:.7f},{n},{1e5 * v + 0.5 * (n % 2):.4f}"
        for (x, y), n, v in zip(places, number, value, strict=True)
    ]
    path.write_text("\n".join(["latitude,longitude,line,dg[mGal]", *rows]))
    return path


def test_it_writes_a_map_that_says_its_error(survey, tmp_path):
    out = tmp_path / "map.nc"
    found = json.loads(answer("map", "grid", survey, out, "--spacing", 500, "--level", "--json"))
    assert found["survey"]["lines"] == 9
    assert found["survey"]["left_out"]["by"] == "lines"
    crossings = found["survey"]["cross_overs"]
    assert crossings["after"]["rms"] < crossings["before"]["rms"]
    field_map = load_map(out)
    assert field_map.sigma.shape == field_map.shape == tuple(found["nodes"])
    text = answer("map", "grid", survey, out, "--spacing", 800, "--block", 0)
    assert "scaled by others than those it is of" in text
    assert "method " in text
    assert text.endswith(f"{out}\n")


def test_a_column_that_is_not_used_is_said(survey, tmp_path):
    header, first, *others = survey.read_text().splitlines()
    lines = [f"{header},height", f"{first},", *(f"{line},300" for line in others)]
    path = tmp_path / "gaps.csv"
    path.write_text("\n".join(lines))
    text = answer("map", "grid", path, tmp_path / "map.nc", "--spacing", 2000)
    assert f"height is not used: 1 of {len(lines) - 1} readings have none" in " ".join(
        text.split()
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--height", "100"), "no column height"),
        (("--spacing", "-1"), "must be > 0"),
        (("--variable", "mag"), "has no column 'mag'"),
        (("--trend", "4"), "'--trend'"),
    ],
)
def test_bad_input_is_one_line(survey, tmp_path, words, message):
    assert message in refusal("map", "grid", survey, tmp_path / "map.nc", *words)
