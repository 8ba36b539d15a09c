"""Tracks in CSV files: what is read, and the line with which other files are refused."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.tracks import field_of, made_track, write_csv
from isogal.errors import InputError
from isogal.magnetics.readings import BaseStation
from isogal.tracks.csv_file import read_csv_tracks
from isogal.tracks.track import Track

GOOD = "time,latitude,longitude,value\n0,1,2,3\n1,1,2,4\n2,1,2,5\n"


def file_of(tmp_path, text):
    path = tmp_path / "track.csv"
    path.write_text(text)
    return path


def one_track(path, crs=None):
    (track,) = read_csv_tracks(path, crs)
    return track


def test_round_trip(tmp_path):
    track, _, _ = made_track(field_of("height"), sigma=2.0)
    columns = "value,time,sigma,longitude,latitude,offset"
    path = write_csv(tmp_path / "t.csv", track, columns, factor=10.0)
    found = one_track(path).in_unit(10.0, None)
    for name in columns.split(","):
        np.testing.assert_allclose(getattr(found, name), getattr(track, name), rtol=1e-10)
    assert found.factor == 10.0


def test_units_of_the_header_count(tmp_path):
    text = "latitude[rad],longitude [degrees_east],value[mGal],sigma[µGal],offset\n"
    found = one_track(file_of(tmp_path, text + "0.5,2,3,100,7\n0.5,3,4,200,8\n"))
    np.testing.assert_allclose(found.latitude, 0.5)
    np.testing.assert_allclose(np.degrees(found.longitude), [2, 3])
    assert found.unit == "mGal"
    np.testing.assert_allclose([*found.value, *found.sigma, *found.offset], [3, 4, 0.1, 0.2, 7, 8])


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_comments_order_and_other_columns(tmp_path, separator):
    rows = "Time,note,LATITUDE,longitude,value\n0,a,1,2,3\n\n# more\n1,b,1,2,4\n2,,1.5,2e0,-5\n"
    text = "\ufeff# made by hand\n" + rows.replace(",", separator)
    found = one_track(file_of(tmp_path, text))
    np.testing.assert_array_equal([found.time, found.value], [[0, 1, 2], [3, 4, -5]])
    assert np.isnan(found.sigma).all()
    assert not found.offset.any()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (GOOD, "", "is empty; it needs a header with latitude, longitude, value"),
        (
            *("latitude", "latitud"),
            r"has no column 'latitude' \(is it 'latitud'\?\); it has time, latitud, longitude, v",
        ),
        ("value", "time", "has no column 'value'|has 2 columns 'time'"),
        ("1,2,4", "1,,4", "longitude in line 3 is empty, not a number"),
        ("1,2,4", "inf,2,4", "latitude in line 3 is inf, not a finite number"),
        ("1,2,4", "91,2,4", "latitude in line 3 is 91 deg, must be -90 to 90"),
        ("1,2,4", "1,-200,4", "longitude in line 3 is -200 deg, must be -180 to 360"),
        ("\n1,", "\n7,", r"times must increase; line 4 .2 s. is not later than line 3 .7 s."),
        ("\n1,", "\n0,", r"times must increase; line 3 .0 s. is not later than line 2 .0 s."),
        ("2,3\n1,1,2,4", '2,"3\n1,1,2,4"', "quoted cell runs over several lines"),
    ],
)
def test_bad_files_end_in_one_clear_line(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message) as caught:
        one_track(file_of(tmp_path, GOOD.replace(old, new)))
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "track.csv"))


def test_sigma_must_be_said_and_positive(tmp_path):
    with pytest.raises(InputError, match="has no column sigma; give --sensor-sigma"):
        one_track(file_of(tmp_path, GOOD)).in_unit(1.0, None)
    text = "time,latitude,longitude,value,sigma\n0,1,2,3,1\n1,1,2,4,0\n2,1,2,5,1\n"
    with pytest.raises(InputError, match="sigma in line 3 is 0, must be > 0"):
        one_track(file_of(tmp_path, text))


@pytest.mark.parametrize("cell", ["", "*", "NaN", "-99999"])
def test_missing_readings(tmp_path, cell):
    found = one_track(file_of(tmp_path, GOOD.replace("1,2,4", f"1,2,{cell}")))
    np.testing.assert_array_equal(np.isnan(found.value), [False, True, False])
    assert found.in_unit(1.0, 1.0).time.size == 3


def test_stations_without_time_and_iso_times(tmp_path):
    found = one_track(file_of(tmp_path, "lat lon value\n1 2 3\n1 2 4\n1 2 5\n"))
    assert not found.timed
    np.testing.assert_array_equal(found.time, [0, 1, 2])
    text = "time,lat,lon,value\n2020-01-01T00:00:00Z,1,2,3\n2020-01-01 00:00:01.5,1,2,4\n"
    found = one_track(file_of(tmp_path, text))
    np.testing.assert_allclose(found.time, [1577836800.0, 1577836801.5])


def test_projected_coordinates_need_their_system(tmp_path):
    text = "easting,northing,value\n500000,5800000,3\n500100,5800000,4\n"
    with pytest.raises(InputError, match="x and y are not places in EPSG:32755"):
        one_track(file_of(tmp_path, text.replace("0000,", "e300,")), "EPSG:32755")
    found = one_track(file_of(tmp_path, text), "EPSG:32755")
    np.testing.assert_allclose(np.degrees(found.longitude[0]), 147.0, atol=1e-9)
    assert -38.5 < np.degrees(found.latitude[0]) < -37.5


def test_lines_of_a_geosoft_file_and_of_a_column(tmp_path):
    text = "/ made by hand\n/ lat long value\nLine 10\n1 2 3\n1 2 *\nTie 20\n1 2 5\n"
    tracks = read_csv_tracks(file_of(tmp_path, text))
    assert [(one.line, one.time.size) for one in tracks] == [("10", 2), ("20", 1)]
    text = "line,lat,lon,value\nA,1,2,3\nB,1,2,4\nA,1,2,5\n"
    tracks = read_csv_tracks(file_of(tmp_path, text))
    np.testing.assert_array_equal(tracks[0].value, [3, 5])


@pytest.mark.parametrize("note", ["1", "a"])
def test_the_unit_of_times_counts_whatever_else_the_file_holds(tmp_path, note):
    def read(unit, stamps=range(3)):
        rows = [f"{stamp},1,2,{k},{note}" for k, stamp in enumerate(stamps)]
        text = "\n".join([f"time{unit},latitude,longitude,value,note", *rows])
        return one_track(file_of(tmp_path, text)).time

    for unit, factor in (("[min]", 60.0), (" (s)", 1.0), ("[Hours]", 3600.0), ("", 1.0)):
        np.testing.assert_array_equal(read(unit), factor * np.arange(3))
    with pytest.raises(InputError, match="time: unknown unit 'fortnights'; must be seconds, min"):
        read("[fortnights]")
    assert np.ptp(read(" (UTC)", [f"2026-01-01T00:0{k}:00" for k in range(3)])) == 120.0


@pytest.mark.parametrize(("separator", "quote"), [(",", '"'), (" ", "")])
def test_lines_of_numbers_are_called_what_is_written(tmp_path, separator, quote):
    names = ["007", "20240115001", "20240115002"]
    rows = [f"1,2,{k},{quote}{name}{quote}" for name in names for k in range(3)]
    text = "\n".join(["latitude,longitude,value,line", *rows]).replace(",", separator)
    found = read_csv_tracks(file_of(tmp_path, text))
    assert [(one.line, len(one)) for one in found] == [(name, 3) for name in names]


def test_a_base_stations_variation_is_taken_off():
    station = BaseStation(np.array([0.0, 100.0]), np.array([50_000.0, 50_020.0]), "base")
    value = np.array([5.0, 7.0])
    track = Track(np.array([0.0, 50.0]), *np.zeros((2, 2)), value, np.ones(2), np.zeros(2), "t")
    np.testing.assert_allclose(track.less_variation(station).value, [15.0, 7.0])
    with pytest.raises(InputError, match="needs the track's column time"):
        replace(track, timed=False).less_variation(station)
    with pytest.raises(InputError, match="neither"):
        replace(station, value=np.array([4000.0, 4000.0]))
    with pytest.raises(InputError, match="does not cover"):
        replace(track, time=np.array([0.0, 200.0])).less_variation(station)
