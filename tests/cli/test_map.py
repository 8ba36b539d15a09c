"""``isogal map``: what it prints, writes and refuses."""

import json
import threading

import numpy as np
import pytest
from typer.testing import CliRunner

from isogal.cli.main import app
from isogal.maps.formats.netcdf import read_netcdf, write_netcdf
from isogal.maps.ggmplus.folder import is_ggmplus

ROUTE = "-36.9,144.7 -36.2,145.4"


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ISOGAL_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def file(small_map, tmp_path):
    write_netcdf(small_map, tmp_path / "map.nc")
    return str(tmp_path / "map.nc")


def isogal_map(*args, status=0):
    result = CliRunner().invoke(app, ["map", *map(str, args)])
    assert result.exit_code == status, result.output
    if status:
        assert result.stderr.count("\n") == 1 and result.stderr.startswith("isogal: ")
        return result.stderr
    return result.stdout


def is_png(path):
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000


@pytest.mark.parametrize("command", ["", "info", "variability", "synth", "fetch", "convert"])
def test_help(command):
    assert "Usage" in isogal_map(*command.split(), "--help")


def test_info(file, small_map):
    found = json.loads(isogal_map("info", file, "--json"))
    assert (found["quantity"], found["unit"], found["nodes"]) == ("disturbance", "m/s²", [20, 24])
    assert found["minimum"] == pytest.approx(small_map.values.min()) and found[
        "maximum"
    ] == pytest.approx(small_map.values.max())
    assert found["mean"] == pytest.approx(small_map.values.mean())
    assert found["standard_deviation"] == pytest.approx(small_map.values.std())
    assert (found["south"], found["east"]) == (pytest.approx(-37.0), pytest.approx(145.65))
    text = isogal_map("info", file)
    assert "mGal" in text and "disturbance" in text


def test_info_along_a_route(file, tmp_path):
    picture = tmp_path / "picture.png"
    found = json.loads(
        isogal_map(
            "info",
            file,
            "--route",
            ROUTE,
            "--set",
            "gravimeter.sigma=1e-6",
            "--figure",
            picture,
            "--json",
        )
    )
    route = found["route"]
    assert len(route["stretches"]) == round(route["length_km"] / 5.0)
    assert all(0.0 < part["sigma_best"] <= part["sigma_worst"] for part in route["stretches"])
    assert is_png(picture)
    worse = json.loads(
        isogal_map("info", file, "--route", ROUTE, "--sensor-sigma", "1e-5", "--json")
    )["route"]
    assert worse["stretches"][0]["sigma_best"] > 5.0 * route["stretches"][0]["sigma_best"]
    assert "worst (m)" in isogal_map("info", file, "--route", ROUTE)


def test_pictures_of_odd_maps(small_map, tmp_path):
    """Holes, a long strip, one value only, a map without a track."""
    from dataclasses import replace

    from isogal.cli.map_figures import map_figure
    from isogal.evaluation.figures.style import png

    holed = np.where(small_map.values > 4e-4, np.nan, small_map.values)
    for odd in (
        replace(small_map, values=holed),
        replace(small_map, values=np.full_like(holed, 1e-4)),
        replace(small_map, latitude=small_map.latitude[:6], values=small_map.values[:6]),
        replace(small_map, values=holed.astype(np.float32)),
    ):
        assert png(map_figure(odd)).startswith(b"\x89PNG")


def test_variability(file, tmp_path):
    picture = tmp_path / "picture.png"
    found = json.loads(
        isogal_map(
            "variability", file, "--route", ROUTE, "--samples", "50", "--figure", picture, "--json"
        )
    )
    assert found["samples"] == 50 and len(found["places"]) > 300
    assert found["places"][0]["normalised"] == pytest.approx(1.0)
    assert is_png(picture)
    assert "normalised" in isogal_map("variability", file, "--route", ROUTE)
    assert "odd" in isogal_map("variability", file, "--route", ROUTE, "--points", "4", status=2)


def test_synth_and_convert(tmp_path):
    out = tmp_path / "synthetic.nc"
    isogal_map(
        "synth",
        "--window",
        "-37.1",
        "-37.0",
        "145.0",
        "145.1",
        "--quantity",
        "disturbance",
        "--out",
        out,
    )
    field_map = read_netcdf(out)
    assert (field_map.quantity, field_map.quantisation) == ("disturbance", 1e-6)
    found = json.loads(isogal_map("convert", out, tmp_path / "tiles", "--to", "ggmplus", "--json"))
    assert found["file"] == str(tmp_path / "tiles") and is_ggmplus(tmp_path / "tiles")
    back = tmp_path / "back.nc"
    isogal_map(
        "convert",
        tmp_path / "tiles",
        back,
        "--window",
        "-37.08",
        "-37.02",
        "145.02",
        "145.08",
        "--sigma",
        "3e-5",
        "--correlation-length",
        "4000",
    )
    again = read_netcdf(back)
    assert (again.sigma, again.correlation_length) == (3e-5, 4000.0)
    at = np.radians([-37.05, -37.03]), np.radians([145.05, 145.04])
    np.testing.assert_allclose(again.value(*at), field_map.value(*at), rtol=0, atol=1e-12)


def test_info_of_the_synthetic_map():
    found = json.loads(
        isogal_map(
            "info", "synthetic", "--route", "-37.1,145.1 -37.05,145.2", "--margin", "5", "--json"
        )
    )
    assert found["quantity"] == "gravity" and found["route"]["length_km"] == pytest.approx(
        10.5, abs=0.5
    )


def test_fetch(tmp_path, monkeypatch):
    from http.server import BaseHTTPRequestHandler, HTTPServer

    class Mirror(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200 if "S40E145" in self.path else 404)
            self.send_header("Content-Length", "20000" if "S40E145" in self.path else "0")
            self.end_headers()
            if "S40E145" in self.path:
                self.wfile.write(bytes(20_000))

        def log_message(self, *_):
            """Be silent."""

    monkeypatch.setattr("isogal.maps.ggmplus.fetch.CELLS", 100)
    server = HTTPServer(("127.0.0.1", 0), Mirror)
    threading.Thread(
        target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
    ).start()
    options = [
        "--base-url",
        f"http://127.0.0.1:{server.server_address[1]}",
        "--out",
        tmp_path / "g",
        "--variable",
        "dg",
    ]
    try:
        found = json.loads(isogal_map("fetch", "--route", "-38,144 -38,146", *options, "--json"))
        assert (found["downloaded"], found["absent"]) == (["S40E145.dg"], ["S40E140.dg"])
        text = isogal_map("fetch", "--route", "-38,144 -38,146", *options)
        assert "S40E145.dg  there already" in text and "not on the server" in text
    finally:
        server.shutdown()
        server.server_close()
    options[1] = "http://127.0.0.1:9"
    assert "offline?" in isogal_map(
        "fetch", "--window", "-32", "-31", "146", "147", *options, "--tries", "1", status=2
    )


@pytest.mark.parametrize(
    "args,words",
    [
        (("info", "nix.nc"), "no such file"),
        (("info", "{file}", "--variable", "nix"), "no variable 'nix'"),
        (("info", "{file}", "--route", "1,2 x,4"), "'x,4' must be LATITUDE,LONGITUDE"),
        (("info", "{file}", "--route", "1,2"), "at least two points"),
        (
            ("info", "{file}", "--route", "-36.9,144.7 -35.0,144.7"),
            "does not cover the route: no value at -36.",
        ),
        (("info", "{file}", "--window", "3", "2", "1", "4"), "must be SOUTH NORTH WEST EAST"),
        (("info", "{file}", "--set", "rute.speed=3"), "unknown key 'rute'"),
        (("info", "{file}", "--figure", "a.gif"), "must end in .png"),
        (("info", "{file}", "--format", "nix"), "unknown format 'nix'"),
        (("info", "{file}", "--crs", "EPSG:4326"), "crs can only be given for geotiff"),
        (
            ("synth", "--out", "/nowhere/x.nc", "--window", "-37.1", "-37.0", "145.0", "145.1"),
            "cannot be written",
        ),
        (
            (
                "synth",
                "--out",
                "x.nc",
                "--window",
                "-37.1",
                "-37.0",
                "145.0",
                "145.1",
                "--quantity",
                "geoid",
            ),
            "not geoid",
        ),
        (("convert", "{file}", "out.tif"), "must end in .nc"),
        (("convert", "{file}", "out.nc", "--to", "gif"), "must be netcdf or ggmplus"),
        (("fetch", "--base-url", "ftp://x"), "must begin with http"),
        (("fetch", "--base-url", "http://x", "--variable", "zz"), "GGMplus has ga"),
        (("fetch",), "--base-url"),
    ],
)
def test_refusals(file, args, words):
    assert words in isogal_map(*(arg.format(file=file) for arg in args), status=2)
