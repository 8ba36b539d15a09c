"""The example of a plugin, installed as a user would: its names are known, and work, only then."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from helpers import installed
from helpers.command_line import answer, refusal
from helpers.commands import isogal
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf

ROOT = Path(__file__).resolve().parents[2]
SIGMA = 1e-5
ERROR = (600.0, -400.0)
"""North, east; m. What is wrong with the recorded positions."""


@pytest.fixture(scope="module")
def plugin(tmp_path_factory) -> Path:
    """Folder in which the example is installed."""
    folder = tmp_path_factory.mktemp("plugin")
    source = shutil.copytree(ROOT / "examples" / "plugin", folder / "source")  # pip writes into it
    options = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation"]
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", *options]
    subprocess.run(
        [*command, "--target", folder / "installed", source], check=True, timeout=120, cwd=folder
    )
    return folder / "installed"


@pytest.fixture(scope="module")
def inputs(tmp_path_factory) -> tuple[Path, Path]:
    """Map in the example's format, mGal, and a track over it whose positions are wrong."""
    folder = tmp_path_factory.mktemp("inputs")
    nodes, step, south, west = 121, 0.002, -37.1, 145.0

    def field(latitude, longitude):
        north, east = 111e3 * (latitude - south), 88e3 * (longitude - west)
        return 10.0 * (np.sin(north / 700.0) + np.cos(east / 900.0 + north / 2000.0))

    latitude, longitude = south + step * np.arange(nodes), west + step * np.arange(nodes)
    values = field(latitude[:, None], longitude[None, :])
    header = f"ncols {nodes}\nnrows {nodes}\nxllcenter {west}\nyllcenter {south}\ncellsize {step}"
    np.savetxt(folder / "map.asc", values[::-1], header=header, comments="", fmt="%.5f")
    place = np.stack([south + 0.03 + 0.0016 * np.arange(90), west + 0.03 + 0.002 * np.arange(90)])
    noise = 1e5 * SIGMA * np.random.default_rng(1).standard_normal(90)
    north, east = (np.degrees(1.0 / m) for m in metres_per_radian(np.radians(south)))
    columns = (
        10.0 * np.arange(90),
        place[0] + ERROR[0] * north,
        place[1] + ERROR[1] * east,
        field(*place) + noise,
    )
    np.savetxt(
        folder / "track.csv",
        np.stack(columns, axis=1),
        delimiter=",",
        header="time,latitude,longitude,value",
        comments="",
        fmt="%.9f",
    )
    return folder / "map.asc", folder / "track.csv"


def match(inputs: tuple[Path, Path], *options: str) -> tuple[str | Path, ...]:
    """A command line."""
    return (
        *("match", "--map", inputs[0], "--quantity", "disturbance", "--unit", "mGal"),
        *("--track", inputs[1], "--prior-sigma", "500", *options),
    )


def test_matcher_and_map_format_are_known_once_installed(plugin, inputs):
    with installed.known(plugin):
        fixes = json.loads(answer(*match(inputs, "--matcher", "least-squares", "--json")))
    assert [fix["time"] for fix in fixes] == [290.0, 590.0, 890.0]
    track = {row[0]: row[1:] for row in np.loadtxt(inputs[1], delimiter=",", skiprows=1)}
    for fix in fixes:
        latitude, longitude, _ = track[fix["time"]]
        north, east = metres_per_radian(np.radians(latitude))
        found = (
            np.radians(latitude - fix["latitude"]) * north,
            np.radians(longitude - fix["longitude"]) * east,
        )
        np.testing.assert_allclose(found, ERROR, atol=100.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "map.asc: not a known map format by its name; known: "),
        (("--format", "esri-ascii"), "unknown map format 'esri-ascii'; allowed: "),
        (("--matcher", "least-squares"), "matcher.name: unknown matcher 'least-squares'"),
    ],
)
def test_without_it_its_names_are_unknown(inputs, options, words):
    assert words in refusal(*match(inputs, *options))


@pytest.mark.ros
def test_a_graph_measures_and_matches_its_field(plugin, inputs, tmp_path):
    """Its field, messages and matcher together, with the same map in another format. A run in one
    process leaves the home folder alone, where ROS puts its logs unless told otherwise."""
    (tmp_path / "home").mkdir()
    grid, out = tmp_path / "map.nc", tmp_path / "run"
    values = 1e-5 * np.loadtxt(inputs[0], skiprows=5)[::-1]
    west, south, step = (float(line.split()[1]) for line in inputs[0].open().readlines()[2:5])
    axes = (np.radians(at + step * np.arange(len(values))) for at in (south, west))
    write_netcdf(FieldMap(*axes, values, "m/s²", "gravity_anomaly"), grid)
    settings = (
        *("field=free-air", "matcher.name=least-squares", f"map.source={grid}"),
        *("route.start=[-37.05, 145.05]", "route.end=[-36.9, 145.2]", "route.duration=320"),
        "gravity.field=normal",
    )
    options = [word for item in settings for word in ("--set", item)]
    folders = "--out", out, "--bag", tmp_path / "bag"
    environment = os.environ | {"PYTHONPATH": str(plugin), "HOME": str(tmp_path / "home")}
    words = "run", "--in-process", "--json", *folders, *options
    done = isogal(*words, figures=False, environment=environment)
    assert done.returncode == 0, done.stderr
    summary = json.loads((out / "summary.json").read_text())
    assert json.loads(done.stdout) == summary
    assert summary["fixes"] == {"published": 1, "declined": 0, "failed": 0, "rejected": 0}
    bag = (tmp_path / "bag" / "metadata.yaml").read_text()
    assert "gravimeter/free_air_anomaly" in bag
    assert not (tmp_path / "home" / ".ros").exists()
