"""What `isogal map synth` and `convert` write: the same values, and what the options add."""

import json

import numpy as np

from helpers.command_line import answer
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
