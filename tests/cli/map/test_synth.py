"""The file that `isogal map synth` writes."""

import json

import pytest

from helpers.command_line import answer, refusal
from isogal.maps.load import load_map

WINDOW = ("--window", -37.1, -37.0, 145.0, 145.1)


def test_a_window_becomes_a_file(tmp_path):
    out = tmp_path / "synthetic.nc"
    words = ("map", "synth", *WINDOW, "--quantity", "disturbance", "--out", out)
    assert answer(*words).endswith(f"{out}\n")
    field_map = load_map(out)
    assert (field_map.quantity, field_map.quantisation) == ("disturbance", 1e-6)
    assert json.loads(answer(*words, "--json"))["file"] == str(out)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--out", "/dev/null/x.nc", *WINDOW), "cannot be written"),
        (("--out", "x.nc", *WINDOW, "--quantity", "geoid"), "not geoid"),
        (("--out", "x.nc", *WINDOW, "--set", "rute.speed=3"), "unknown key 'rute'"),
        (("--out", "x.tif", *WINDOW), "x.tif: must end in .nc"),
        (WINDOW, "Missing option '--out'"),
    ],
)
def test_bad_input_ends_in_one_line(words, message):
    assert message in refusal("map", "synth", *words)
