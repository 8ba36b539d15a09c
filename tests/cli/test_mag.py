"""`isogal mag`: from a calibration flight to a compensated track."""

import csv
import json

import numpy as np
import pytest

from helpers.command_line import answer, refusal
from helpers.magnetics import INTENSITY, Circumstances, aircraft, fly, spread, write_flight
from isogal.magnetics.compensation import read_compensation
from isogal.magnetics.manoeuvres import calibration_flight, ordinary_flight
from isogal.magnetics.readings import Readings
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.sensors.magnetometer import intensity

AROUND = Circumstances(noise=0.02)
LAG = ("--lag", 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("mag")


@pytest.fixture(scope="module")
def calibration(folder):
    flight = calibration_flight(rate=5.0)
    readings, _ = fly(flight, aircraft(), AROUND)
    return write_flight(folder / "calibration.csv", flight, readings)


@pytest.fixture(scope="module")
def coefficients(folder, calibration):
    answer("mag", "calibrate", calibration, "--out", folder / "own.yaml", *LAG)
    return folder / "own.yaml"


def test_calibrate_writes_coefficients_and_a_report(tmp_path, calibration):
    out = tmp_path / "own.yaml"
    words = ("mag", "calibrate", calibration, "--out", out, "--report", tmp_path / "report", *LAG)
    found = json.loads(answer(*words, "--json"))
    assert found["improvement"] > 50.0
    assert 150.0 < found["own_field_peak_to_peak"] < 300.0
    by_heading = found["own_field_by_heading"]
    assert max(by_heading.values()) - min(by_heading.values()) > 50.0
    assert found["files"] == [str(out), str(tmp_path / "report" / "report.html")]
    assert (tmp_path / "report" / "calibration.png").read_bytes().startswith(b"\x89PNG")
    assert "heading" in (tmp_path / "report" / "report.html").read_text()
    assert read_compensation(out).coefficients.size == 18


def test_compensate_leaves_the_anomaly(tmp_path, coefficients):
    flight = ordinary_flight(3, minutes=5.0, rate=5.0)
    readings, total = fly(flight, aircraft(), AROUND, seed=2)
    path, out = write_flight(tmp_path / "flight.csv", flight, readings), tmp_path / "track.csv"
    words = ("mag", "compensate", path, "--coefficients", coefficients, "--out", out, "--json")
    found = json.loads(answer(*words))
    with out.open() as stream:
        rows = list(csv.DictReader(stream))
    value = np.array([float(row["value"]) for row in rows])
    place = [np.array([float(row[name]) for row in rows]) for name in ("latitude", "longitude")]
    truth = total - intensity(*place, 500.0, 2025.0)
    assert np.ptp(readings.total - total) > 100.0
    assert spread(value - truth) < 0.7
    assert (found["readings"], found["without"]) == (len(rows), 0)


def test_learning_on_the_way(tmp_path):
    flight = ordinary_flight(3, minutes=14.0, rate=2.0)
    readings, total = fly(flight, aircraft(), AROUND, seed=2)
    path, out = write_flight(tmp_path / "flight.csv", flight, readings), tmp_path / "track.csv"
    words = ("mag", "compensate", path, "--out", out)
    answer(*words, "--online", "--learnt", tmp_path / "learnt.yaml")
    found = np.array([float(row.split(",")[4] or "nan") for row in out.read_text().split()[1:]])
    assert np.isnan(found[0])
    assert spread((found - total)[flight.time > 600.0]) < 15.0
    answer(*words, "--coefficients", tmp_path / "learnt.yaml")
    found = np.array([float(row.split(",")[4]) for row in out.read_text().split()[1:]])
    assert spread(found - total) < 15.0
    assert "--coefficients" in refusal(*words)
    assert "--learnt" in refusal(*words, "--learnt", tmp_path / "learnt.yaml")


def some_seconds(path, since):
    """Write half a minute of an ordinary flight whose times begin at `since`."""
    flight = ordinary_flight(3, minutes=0.5, rate=5.0)
    readings, _ = fly(flight, aircraft(), AROUND)
    return write_flight(path, flight, readings, time=since + readings.time)


def test_a_base_station_takes_the_daily_variation_off(tmp_path, coefficients):
    base = tmp_path / "base.csv"
    base.write_text("time,scalar\n0,50000\n1000,50000\n2000,50080\n")
    path = some_seconds(tmp_path / "flight.csv", 1500.0)
    words = ("mag", "compensate", path, "--coefficients", coefficients, "--out")
    answer(*words, tmp_path / "with.csv", "--base", base)
    answer(*words, tmp_path / "without.csv")
    a, b = (float((tmp_path / f"{n}.csv").read_text().splitlines()[1].split(",")[4])
            for n in ("with", "without"))  # fmt: skip
    assert b - a == pytest.approx(40.0, abs=0.2)
    base.write_text("time,scalar\n0,50000\n1000,50000\n")
    assert "does not cover" in refusal(*words, tmp_path / "x.csv", "--base", base)


def test_match_takes_both_magnetometers(tmp_path, coefficients):
    # a map of the anomaly that is in the readings; the flight is recorded 300 m too far north
    flight = ordinary_flight(3, minutes=5.0, rate=5.0)
    north, east = np.linspace(-2e4, 2e4, 200), np.linspace(-2e4, 2e4, 200)
    anomaly = 100.0 * np.outer(np.sin(2e-3 * np.pi / 4 * north), np.cos(2e-3 * np.pi / 5 * east))
    axes = np.radians(56.0 + north / 111_200.0), np.radians(-4.0 + east / 62_200.0)
    write_netcdf(FieldMap(*axes, anomaly, "nT", "magnetic_anomaly"), tmp_path / "map.nc")
    readings, _ = fly(flight, aircraft(), Circumstances(anomaly=100.0, noise=0.02), seed=2)
    place = 56.0 + flight.north / 111_200.0, -4.0 + flight.east / 62_200.0
    level = intensity(*place, 500.0, 2025.0) - INTENSITY  # of the model, not that of the helper
    level = level + readings.time  # and a daily variation of a nT each second
    felt = Readings(readings.time, readings.total + level, readings.vector, "flight")
    (tmp_path / "base.csv").write_text("time,scalar\n-400,-400\n400,400\n")
    path = write_flight(tmp_path / "flight.csv", flight, felt, latitude=place[0] + 300 / 111_200)
    words = ("match", "--map", tmp_path / "map.nc", "--track", path, "--sensor-sigma", 1,
             "--map-sigma", 0, "--spacing", 100, "--prior-sigma", 500, "--batch-length", "all",
             "--json", "--out", tmp_path / "fixes.json")  # fmt: skip
    answer(*words, "--compensation", coefficients, "--base", tmp_path / "base.csv")
    fix = json.loads((tmp_path / "fixes.json").read_text())[0]
    there = np.interp(fix["time"], flight.time, place[0])
    assert 111_200.0 * (fix["latitude"] - there) == pytest.approx(0.0, abs=60.0)
    assert "no column 'value'" in refusal(*words)
    mgal = ("--base", tmp_path / "base.csv", "--track-unit", "mGal")
    assert "--base: is in nT, --track-unit is mGal" in refusal(*words, *mgal)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"scalar": None}, "no column 'scalar'"),
        ({"scalar": 5e-5 * np.ones(300)}, "in nT"),
        ({"scalar": 5e4 * np.ones(300)}, "one reading only"),
        ({"vector_x": np.zeros(300), "vector_y": np.zeros(300)}, "no calibration manoeuvres"),
        ({"time": np.zeros(300)}, "times must increase"),
        ({"latitude": np.full(300, 95.0)}, "latitude in line 2"),
        ({"longitude": None}, "no column 'longitude'"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, columns, said):
    flight = ordinary_flight(3, minutes=1.0, rate=5.0)
    readings, _ = fly(flight, aircraft(), AROUND)
    path = write_flight(tmp_path / "flight.csv", flight, readings, **columns)
    assert said in refusal("mag", "calibrate", path, "--out", tmp_path / "own.yaml", *LAG)
    assert not (tmp_path / "own.yaml").exists()


def test_bad_options_are_refused(tmp_path, calibration):
    out = tmp_path / "own.yaml"
    assert "'--lag'" in refusal("mag", "calibrate", calibration, "--out", out, "--lag", "1e9")
    out.write_text("a: 1\n")
    assert "holds no compensation" in refusal(
        "mag", "compensate", calibration, "--coefficients", out, "--out", tmp_path / "x.csv"
    )
