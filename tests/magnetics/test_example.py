"""The worked example: its data, and the fix that its README promises."""

import json
import runpy

import pytest

from helpers.command_line import answer
from helpers.packages import ROOT


def test_the_fix_is_400_m_south_of_the_recorded_position(tmp_path):
    example = runpy.run_path(str(ROOT / "examples" / "magnetic_aircraft" / "make_flights.py"))
    example["main"](tmp_path, minutes=4.0)
    answer("mag", "calibrate", tmp_path / "calibration.csv", "--out", tmp_path / "own.yaml",
           "--lag", 0)  # fmt: skip
    answer("match", "--map", tmp_path / "map.nc", "--track", tmp_path / "flight.csv",
           "--compensation", tmp_path / "own.yaml", "--spacing", 400, "--sensor-sigma", 1,
           "--batch-length", "all", "--out", tmp_path / "fixes.json")  # fmt: skip
    fix = json.loads((tmp_path / "fixes.json").read_text())[0]
    recorded = (tmp_path / "flight.csv").read_text().splitlines()
    at = next(row for row in reversed(recorded) if float(row.split(",")[0]) <= fix["time"])
    moved = (fix["latitude"] - float(at.split(",")[1])) * example["METRES"][0]
    assert moved == pytest.approx(-example["ASTRAY"], abs=40.0)
