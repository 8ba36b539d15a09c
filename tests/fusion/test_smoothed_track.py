"""A smoothed voyage as files that others read."""

import csv
import io
import json
from xml.etree import ElementTree

import numpy as np
import pytest

from helpers.navigators import fly
from isogal.fusion.smoothed_track import SmoothedTrack, as_csv, as_geojson, as_gpx, write_smoothed

FLIGHT = fly()


def track(*longitudes: float) -> SmoothedTrack:
    states = []
    for k, longitude in enumerate(longitudes):
        state = FLIGHT.start.copy()
        state.position[:] = np.radians(-36.5 + 0.001 * k), np.radians(longitude), 100.0
        states.append(state)
    return SmoothedTrack(10.0 * np.arange(len(longitudes)), states)


def test_csv(tmp_path) -> None:
    paths = write_smoothed(track(147.0, 147.002), tmp_path)
    assert [path.name for path in paths] == ["smoothed.csv", "smoothed.geojson", "smoothed.gpx"]
    assert all(path.stat().st_size > 100 for path in paths)
    rows = list(csv.DictReader(io.StringIO(paths[0].read_text())))
    assert [float(row["time"]) for row in rows] == [0.0, 10.0]
    assert float(rows[1]["longitude"]) == pytest.approx(147.002, abs=1e-9)
    velocity, P = FLIGHT.start.velocity, FLIGHT.start.covariance
    assert float(rows[0]["velocity_east"]) == pytest.approx(velocity[1], abs=1e-4)
    for name, expected in (
        ("covariance_north_north", P[0, 0]),
        ("variance_velocity_north", P[3, 3]),
        ("variance_heading", np.degrees(np.degrees(P[8, 8]))),
    ):
        assert float(rows[0][name]) == pytest.approx(expected, rel=1e-4)


def test_stamps_of_real_clocks_keep_milliseconds() -> None:
    made = track(147.0)._replace(time=np.array([1.7e9 + 0.125]))
    row = next(csv.DictReader(io.StringIO(as_csv(made))))
    assert float(row["time"]) == pytest.approx(1.7e9 + 0.125, abs=1e-3)
    assert "2023-11-14T22:13:20.125Z" in as_gpx(made)


def test_geojson_is_cut_at_the_date_line() -> None:
    one = json.loads(as_geojson(track(147.0, 147.002)))["features"][0]
    assert one["geometry"]["type"] == "LineString"
    assert one["geometry"]["coordinates"][1][:2] == pytest.approx([147.002, -36.499])
    assert len(one["properties"]["sigma_north"]) == len(one["properties"]["time"]) == 2
    two = json.loads(as_geojson(track(179.99, 179.999, 180.001, 180.01)))["features"][0]
    assert two["geometry"]["type"] == "MultiLineString"
    assert [len(line) for line in two["geometry"]["coordinates"]] == [2, 2]
    assert two["geometry"]["coordinates"][1][0][0] == pytest.approx(-179.999)


def test_gpx() -> None:
    root = ElementTree.fromstring(as_gpx(track(147.0, 147.002)))
    space = {"gpx": "http://www.topografix.com/GPX/1/1"}
    points = root.findall(".//gpx:trkpt", space)
    assert [float(point.attrib["lon"]) for point in points] == pytest.approx([147.0, 147.002])
    assert points[1].findtext("gpx:time", namespaces=space) == "1970-01-01T00:00:10.000Z"
