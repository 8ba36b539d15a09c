"""What `isogal map continue` writes: the map at another height, which the file says."""

import json
from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of
from helpers.command_line import answer
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map


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
    low = load_map(folder / "level.nc")
    crest = float(low.latitude.mean()) + 2500.0 / 6.36e6, float(low.longitude.mean())
    decay = np.exp(-2.0 * np.pi * 1000.0 / 10e3)
    assert high.value(*crest) == pytest.approx(decay * low.value(*crest), rel=0.01)
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
