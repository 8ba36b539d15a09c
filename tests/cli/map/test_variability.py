"""What `isogal map variability` prints and draws."""

import json

import pytest

from helpers.command_line import answer

ROUTE = ("--route", "-36.9,144.7 -36.2,145.4")


def test_variability_along_a_route(file, tmp_path):
    picture = tmp_path / "picture.png"
    words = ("map", "variability", file, *ROUTE)
    found = json.loads(answer(*words, "--samples", 50, "--figure", picture, "--json"))
    assert (found["samples"], found["points"], found["half_width"]) == (50, 9, 2000.0)
    assert len(found["places"]) > 300
    assert found["places"][0]["normalised"] == pytest.approx(1.0)
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
