"""What `isogal map grid` writes and prints."""

import json

import numpy as np
import pytest

from helpers.command_line import answer, refusal
from helpers.surveys import drawn, flight_lines, four_places
from isogal.maps.load import load_map

__all__ = ["four_places"]


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
        (("--method", "spline"), "must be one of kriging, equivalent-sources, auto"),
        (("--height", "100"), "no column height"),
        (("--unit", "Gal"), "cannot be a disturbance map"),
        (("--variable", "mag"), "has no column 'mag'"),
        (("--spacing", "-1"), "must be > 0"),
        (("--trend", "4"), "'--trend'"),
    ],
)
def test_bad_input_is_one_line(survey, tmp_path, words, message):
    assert message in refusal("map", "grid", survey, tmp_path / "map.nc", *words)
