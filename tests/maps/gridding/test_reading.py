"""Surveys from files, and files that are refused."""

import netCDF4
import numpy as np
import pytest

from helpers.refusals import refusal
from isogal.errors import InputError
from isogal.maps.gridding.reading import read_survey

N = 60
NUMBER = np.arange(N)
LAT = -36.5 + 0.1 * np.sin(NUMBER)
LON = 147.0 + 0.1 * np.cos(1.7 * NUMBER)
VALUE = 10.0 * np.sin(0.4 * NUMBER)


def rows(*columns):
    return [",".join(f"{x:.7f}" for x in row) for row in zip(*columns, strict=True)]


def written(path, header, lines):
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


def test_csv_with_a_unit_in_its_header(tmp_path):
    path = written(
        tmp_path / "a.csv",
        "lat,lon,altitude,line,dg[mGal]",
        rows(LAT, LON, 100.0 + VALUE, np.arange(N) // 10, VALUE),
    )
    survey = read_survey(path)
    assert (survey.quantity, survey.unit, survey.file_unit) == ("disturbance", "m/s²", "mGal")
    np.testing.assert_allclose(survey.value, 1e-5 * VALUE, atol=1e-11)
    np.testing.assert_allclose(np.degrees(survey.latitude), LAT, atol=1e-7)
    np.testing.assert_allclose(survey.height, 100.0 + VALUE, atol=1e-6)
    np.testing.assert_array_equal(survey.line, np.arange(N) // 10)


def test_units_of_all_columns_count(tmp_path):
    header = "lat[rad],lon(degrees_east),altitude[ft],dg[mGal],sigma[µGal]"
    columns = np.radians(LAT), LON, 100.0 + VALUE, VALUE, 50.0 + 0.0 * VALUE
    survey = read_survey(written(tmp_path / "a.csv", header, rows(*columns)))
    np.testing.assert_allclose(np.degrees(survey.latitude), LAT, atol=1e-5)
    np.testing.assert_allclose(survey.height, 0.3048 * (100.0 + VALUE), atol=1e-6)
    np.testing.assert_allclose(survey.sigma, 5e-7)
    path = written(tmp_path / "b.csv", header.replace("[ft]", "[fathom]"), rows(*columns))
    with refusal("altitude: unknown unit 'fathom'; must be one of m, km, cm, mm, ft"):
        read_survey(path)


def test_geosoft_lines_comments_and_missing_numbers(tmp_path):
    text = ["/ made by hand", "/ lon lat alt mag"]
    for k in range(N):
        if k % 20 == 0:
            text.append(f"{'Tie' if k == 40 else 'Line'} {k}.1")
        value = "*" if k == 7 else f"{VALUE[k]:.4f}"
        text.append(f"  {LON[k]:.7f}  {LAT[k]:.7f}  305.5  {value}")
    path = written(tmp_path / "a.xyz", text[0], text[1:])
    survey = read_survey(path, quantity="magnetic_anomaly", unit="nT")
    assert len(survey) == N - 1
    np.testing.assert_array_equal(np.unique(survey.line, return_counts=True)[1], [19, 20, 20])
    assert set(survey.height) == {305.5}


def test_geosoft_lines_keep_numbers_that_name_one_line(tmp_path):
    each = [row.replace(",", " ") for row in rows(LON, LAT, VALUE)]
    for tie, numbers in (("7", [100, 7]), ("100", [0, 1])):
        text = ["Line 100", *each[:40], f"Tie {tie}", *each[40:]]
        path = written(tmp_path / "a.xyz", "/ lon lat dg[mGal]", text)
        assert list(dict.fromkeys(read_survey(path).line.tolist())) == numbers


def test_names_after_a_title_or_a_comment(tmp_path):
    for title in ("Survey of 2020, second part", "/ made by hand yesterday"):
        lines = ["lat,lon,dg[mGal]", *rows(LAT, LON, VALUE)]
        survey = read_survey(written(tmp_path / "a.csv", title, lines))
        np.testing.assert_allclose(np.degrees(survey.latitude), LAT, atol=1e-7)


def test_projected_coordinates_need_their_system(tmp_path):
    import pyproj

    x, y = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32755", always_xy=True).transform(
        LON, LAT
    )
    path = written(tmp_path / "a.csv", "x,y,dg[mGal]", rows(x, y, VALUE))
    survey = read_survey(path, crs="EPSG:32755")
    np.testing.assert_allclose(np.degrees(survey.latitude), LAT, atol=1e-7)
    for crs, message in ((None, "--crs EPSG:N"), ("EPSG:nine", "no coordinate system")):
        with pytest.raises(InputError, match=message):
            read_survey(path, crs=crs)


GOOD = rows(LAT, LON, VALUE)
COMMAS = [row.replace(",", ";").replace(".", ",") for row in GOOD]


@pytest.mark.parametrize(
    ("header", "lines", "message"),
    [
        ("lat,lon,dg[mGal]", [], "has no readings"),
        ("lat,lon,dg[mGal]", GOOD[:20], "at least 30 are needed"),
        ("lat,lon,dg", GOOD, "does not say its unit"),
        ("lat,lon,dg[Gal]", rows(LAT, LON, 500.0 * VALUE), "cannot be a disturbance map"),
        ("lat,lon,a,b", rows(LAT, LON, VALUE, VALUE), "--variable, one of a, b"),
        ("north,up,dg[mGal]", GOOD, "no columns latitude and longitude"),
        ("lat,lon,dg[mGal]", rows(LON, LAT, VALUE), "swapped or projected"),
        ("lat,lon,dg[mGal]", [*GOOD, "1,2,high"], "value in line 62 is 'high', not a number"),
        ("lat,lon,dg[mGal]", [*GOOD, "1,2,1_0"], "value in line 62 is '1_0', not a number"),
        ("lat;lon;dg[mGal]", COMMAS, r"line 2 is '.*', not a number \(write 1.5, not 1,5\)"),
        ("lat,lon,dg[mGal]", ["1,2"], "line 2 has 2 cells"),
        ("lat,lon,dg[mGal]", [*GOOD, f"{GOOD[4].rpartition(',')[0]},99.0"], "contradict each ot"),
        ("lat,lon,dg[mGal]", rows(1e-3 * NUMBER, 2e-3 * NUMBER, VALUE), "on one line"),
        ("lat,lon,dg[mGal],sigma", rows(LAT, LON, VALUE, VALUE), "sigma in line 2 is 0, must be"),
        (GOOD[0], GOOD[1:], "has no header; it needs a header with"),
        ("lat,lon,dg[mGal]", [*GOOD, *GOOD], "120 of 120 readings are duplicates"),
        ("lat,lon,dg[mGal]", rows(LAT + np.arange(N), LON, VALUE), "at most 10"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, header, lines, message):
    path = written(tmp_path / "bad.csv", header, lines)
    with pytest.raises(InputError, match=message) as caught:
        read_survey(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_column_with_gaps_is_not_used_and_said(tmp_path):
    lines = rows(LAT, LON, 100.0 + VALUE, VALUE)
    lines[3] = ",".join(part if k != 2 else "" for k, part in enumerate(lines[3].split(",")))
    survey = read_survey(written(tmp_path / "a.csv", "lat,lon,height,dg[mGal]", lines))
    assert survey.height is None and dict(survey.incomplete) == {"height": 1}
    whole = written(tmp_path / "b.csv", "lat,lon,height,dg[mGal]", lines[4:])
    assert read_survey(whole).height is not None and not read_survey(whole).incomplete


def test_lines_keep_their_names(tmp_path):
    lines = [f"{row},L{k // 20}A" for k, row in enumerate(GOOD)]
    survey = read_survey(written(tmp_path / "a.csv", "lat,lon,dg[mGal],line", lines))
    named = [survey.line_names[number] for number in survey.line.tolist()]
    assert named == [f"L{k // 20}A" for k in range(N)]


def test_readings_taken_twice_count_once(tmp_path):
    survey = read_survey(written(tmp_path / "a.csv", "lat,lon,dg[mGal]", [*GOOD, GOOD[3]]))
    assert len(survey) == N


def netcdf(path, **columns):
    """Write columns of one dimension."""
    with netCDF4.Dataset(path, "w") as dataset:
        dataset.createDimension("station", N)
        for name, values in columns.items():
            dataset.createVariable(name, "f8", ("station",))[:] = values
    return path


def test_netcdf_of_one_dimension(tmp_path):
    path = netcdf(tmp_path / "a.nc", lat=LAT, lon=LON, dg=VALUE, height=5.0 + LAT)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset["dg"].units = "mGal"
    survey = read_survey(path)
    np.testing.assert_allclose(survey.value, 1e-5 * VALUE, atol=1e-12)
    assert survey.height is not None
    with refusal("no column 'tmi'"):
        read_survey(path, "tmi")
    both = netcdf(tmp_path / "b.nc", lat=LAT, lon=LON, dg=VALUE, bouguer_disturbance=VALUE)
    with refusal(f"{both}: does not say which column holds the values; give"):
        read_survey(both)
    path.write_bytes(b"CDF, cut short")
    with refusal("cannot be read as NetCDF"):
        read_survey(path)


def test_a_missing_and_a_binary_file_are_named(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    for words in ("none.csv: cannot be read: No such file", "binary.csv: is not a text file"):
        with refusal(words):
            read_survey(tmp_path / words.split(":")[0])
