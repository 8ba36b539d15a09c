"""Grids written by hand, read back, and broken."""

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.maps.formats.format import Asked
from isogal_example.esri_ascii import FORMAT

HEADER = "ncols 5\nnrows 4\nxllcorner 144.95\nyllcorner -37.05\ncellsize 0.1\nNODATA_value -99\n"
ROWS = [[column + 10 * row for column in range(5)] for row in range(4)]
GRID = {"quantity": "disturbance", "unit": "mGal"}


def read(path, **asked):
    return FORMAT.read(path, Asked(**asked), None)


def text(rows):
    return "\n".join(" ".join(map(str, row)) for row in rows) + "\n"


@pytest.fixture
def write(tmp_path):
    def write(content):
        path = tmp_path / "grid.asc"
        path.write_text(content)
        return path

    return write


def test_rows_run_from_north_to_south(write):
    field_map = read(write(HEADER + text(ROWS)), **GRID)
    np.testing.assert_allclose(np.degrees(field_map.latitude), [-37.0, -36.9, -36.8, -36.7])
    np.testing.assert_allclose(
        np.degrees(field_map.longitude), [145.0, 145.1, 145.2, 145.3, 145.4]
    )
    np.testing.assert_allclose(field_map.values, 1e-5 * np.array(ROWS)[::-1])
    assert (field_map.unit, field_map.quantity) == ("m/s²", "disturbance")


def test_centres_and_missing_values(write):
    header = HEADER.replace("xllcorner 144.95", "XLLCENTER 145").replace("-99", "13")
    field_map = read(write(header + text(ROWS)), **GRID)
    assert np.degrees(field_map.longitude[0]) == pytest.approx(145.0)
    assert np.argwhere(np.isnan(field_map.values)).tolist() == [[2, 3]]


def test_unit_and_quantity_are_asked_for(write):
    path = write(HEADER + text(ROWS))
    with pytest.raises(InputError, match=r"does not say what it is a map of"):
        read(path)
    with pytest.raises(InputError, match=r"does not say its unit"):
        read(path, quantity="disturbance")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (HEADER + text(ROWS[:3]), r"has 15 values, the header says 4 x 5; cut short\?"),
        (HEADER + text(ROWS).replace("13", "x"), r"could not convert string to float: 'x'"),
        (HEADER.replace("ncols 5\n", "") + text(ROWS), r"the header needs ncols as a number"),
        (HEADER.replace("0.1", "wide") + text(ROWS), r"cellsize must be a number, not 'wide'"),
        (HEADER.replace("0.1", "0") + text(ROWS), r"cellsize > 0"),
        (HEADER.replace("-37.05", "5e6") + text(ROWS), r"latitudes must lie within -90 to 90"),
        (HEADER + text([[-99] * 5] * 4), r"no value at all"),
        ("", r"the header needs nrows as a number; is it an ESRI ASCII grid\?"),
    ],
)
def test_broken_files_give_one_line(write, content, message):
    with pytest.raises(InputError, match=message) as caught:
        read(write(content), **GRID)
    assert str(caught.value).startswith(str(write(content)))
    assert "\n" not in str(caught.value)
