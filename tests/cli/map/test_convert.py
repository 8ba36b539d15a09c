"""What `isogal map synth` and `convert` write: the same values, and what the options add."""

import json

import numpy as np

from helpers.command_line import answer
from isogal.maps.ggmplus.reading import is_ggmplus
from isogal.maps.load import load_map

WINDOW = ("--window", -37.1, -37.0, 145.0, 145.1)


def test_a_window_becomes_a_file(tmp_path):
    out = tmp_path / "synthetic.nc"
    words = ("map", "synth", *WINDOW, "--quantity", "disturbance", "--out", out)
    assert answer(*words).endswith(f"{out}\n")
    field_map = load_map(out)
    assert (field_map.quantity, field_map.quantisation) == ("disturbance", 1e-6)
    assert json.loads(answer(*words, "--json"))["file"] == str(out)


def test_to_tiles_and_back(tmp_path):
    tiles, first, back = tmp_path / "tiles", tmp_path / "first.nc", tmp_path / "back.nc"
    answer("map", "convert", "synthetic", first, "--variable", "dg", *WINDOW)
    found = json.loads(answer("map", "convert", first, tiles, "--to", "ggmplus", "--json"))
    assert found["file"] == str(tiles)
    assert is_ggmplus(tiles)
    inner = ("--window", -37.08, -37.02, 145.02, 145.08)
    error = ("--sigma", 3e-5, "--correlation-length", 4000)
    answer("map", "convert", tiles, back, *inner, *error)
    before, after = load_map(first), load_map(back)
    assert (after.sigma, after.correlation_length) == (3e-5, 4000.0)
    at = np.radians([-37.05, -37.03]), np.radians([145.05, 145.04])
    np.testing.assert_allclose(after.value(*at), before.value(*at), rtol=0, atol=1e-12)
