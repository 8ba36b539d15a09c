"""Whatever is wrong with what is asked of `isogal map` ends in one line that says so."""

from dataclasses import replace

import pytest

from helpers.command_line import refusal
from isogal.maps.formats.netcdf_writing import write_netcdf

ROUTE = ("--route", "-36.9,144.7 -36.2,145.4")
WINDOW = ("--window", -37.1, -37.0, 145.0, 145.1)
CASES = {
    "info MAP": [
        (("--route", "1,2 x,4"), "--route: 'x,4' must be LATITUDE,LONGITUDE"),
        (("--route", "1,2"), "at least two points"),
        (("--route", "-36.9,144.7 -35.0,144.7"), "does not cover the route: no value at -36."),
        (("--window", "3", "2", "1", "4"), "--window 3 2 1 4: must be SOUTH NORTH WEST EAST"),
        (("--window", "1", "nan", "1", "4"), "must be SOUTH NORTH WEST EAST"),
        (("--figure", "a.gif"), "a.gif: must end in .png"),
        (("--margin", "inf"), "--margin: must be finite, is inf"),
        (("--margin", "-1"), "'--margin'"),
        ((*ROUTE, "--sensor-sigma", "0"), "--sensor-sigma: must be > 0, is 0"),
        ((*ROUTE, "--sensor-sigma", "0.5"), "did you mean 0.5mGal?"),
        ((*ROUTE, "--map-sigma", "-1e-5"), "--map-sigma: must be >= 0, is -1e-05"),
    ],
    "variability MAP": [
        ((*ROUTE, "--points", "4"), "must be odd"),
        ((*ROUTE, "--points", "99999"), "must be odd, 3 to 1001"),
    ],
    "convert MAP": [
        (("out.tif",), "out.tif: must end in .nc"),
        (("out.nc", "--sigma", "inf"), "--sigma: must be a number, or one with its unit"),
        (("out.nc", "--sigma", "2"), "did you mean 2mGal?"),
    ],
    "continue MAP": [
        (
            ("out.nc", "--height", 500, "--terrain", "x.nc", "--from-height", 0),
            "--from-height 0: cannot be given together with --terrain",
        ),
        (("out.nc", "--height", 5, "--from-height", 0, "--edge", -1), "--edge: must be >= 0"),
    ],
    "synth": [
        (("--out", "/dev/null/x.nc", *WINDOW), "cannot be written"),
        (("--out", "x.nc", *WINDOW, "--quantity", "geoid"), "not geoid"),
        (("--out", "x.tif", *WINDOW), "x.tif: must end in .nc"),
    ],
    "fetch": [
        (("--base-url", "http://x", "--variable", "zz"), "GGMplus has ga"),
        (
            ("--base-url", "http://127.0.0.1:9", "--window", -32, -31, 146, 147, "--tries", 1),
            "offline?",
        ),
    ],
    "navigability MAP": [
        (("--out", "a.png"), "must end in .nc or .nc4 or .tif"),
        (("--set", "field=gradient"), "field gradient"),
    ],
}


@pytest.mark.parametrize(
    ("command", "words", "message"),
    [(command, *case) for command, cases in CASES.items() for case in cases],
)
def test_bad_input_ends_in_one_line(file, tmp_path, monkeypatch, command, words, message):
    monkeypatch.chdir(tmp_path)
    source = [file if word == "MAP" else word for word in command.split()]
    assert message in refusal("map", *source, *words)


def test_the_sensor_of_another_field_must_be_said(tmp_path, small_map):
    values = 1e5 * small_map.values
    magnetic = replace(small_map, values=values, unit="nT", quantity="magnetic_anomaly")
    write_netcdf(magnetic, tmp_path / "m.nc")
    message = refusal("map", "info", tmp_path / "m.nc", *ROUTE)
    assert "--sensor-sigma: must be given for a map in nT" in message
