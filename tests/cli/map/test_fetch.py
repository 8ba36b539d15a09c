"""`isogal map fetch` from a server on this machine."""

import json

import pytest

from helpers.command_line import answer
from helpers.mirror import serving

ROUTE = ("--route", "-38,144 -38,146")


@pytest.fixture
def mirror(monkeypatch):
    """Holds the tiles of one place: 4 bytes a cell of gravity, 2 of its disturbance."""
    monkeypatch.setattr("isogal.maps.ggmplus.fetch.CELLS", 100)
    with serving({"S40E145.ga": bytes(40_000), "S40E145.dg": bytes(20_000)}) as server:
        yield server.url


def test_tiles_are_fetched_once(mirror, tmp_path):
    words = ("map", "fetch", "--base-url", mirror, "--out", tmp_path / "g", "--variable", "dg")
    found = json.loads(answer(*words, *ROUTE, "--json"))
    assert (found["downloaded"], found["absent"]) == (["S40E145.dg"], ["S40E140.dg"])
    text = answer(*words, *ROUTE)
    assert "S40E145.dg  there already" in text
    assert "S40E140.dg  not on the server" in text
    assert text.endswith(f"map.source: {tmp_path / 'g'}\n")


def test_the_field_of_the_scenario_names_the_tiles(mirror, tmp_path):
    words = ("map", "fetch", "--base-url", mirror, "--out", tmp_path / "g", *ROUTE)
    assert "S40E145.ga  fetched, trusted on first use" in answer(*words)
    assert "S40E145.dg  fetched" in answer(*words, "--set", "gravimeter.quantity=disturbance")
