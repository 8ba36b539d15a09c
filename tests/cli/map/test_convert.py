"""What `isogal map convert` writes: the same values, and what the options add."""

import json

import numpy as np
import pytest

from helpers.command_line import answer, refusal
from isogal.maps.ggmplus.reading import is_ggmplus
from isogal.maps.load import load_map


def test_to_tiles_and_back(tmp_path):
    tiles, first, back = tmp_path / "tiles", tmp_path / "first.nc", tmp_path / "back.nc"
    window = ("--window", -37.1, -37.0, 145.0, 145.1)
    answer("map", "convert", "synthetic", first, "--variable", "dg", *window)
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


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("out.tif",), "out.tif: must end in .nc"),
        (("out.nc", "--to", "gif"), "--to gif: must be netcdf or ggmplus"),
        (("out.nc", "--sigma", "inf"), "--sigma: must be finite, is inf"),
        (("out.nc", "--sigma", "nan"), "'--sigma'"),
        (("out.nc", "--correlation-length", "0"), "--correlation-length: must be > 0"),
        ((), "Missing argument 'OUT'"),
    ],
)
def test_bad_input_ends_in_one_line(file, words, message):
    assert message in refusal("map", "convert", file, *words)
