"""What an INS has said, from a text file: columns that are there and that are not."""

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.inertial.ins_file import read_ins_file
from isogal.inertial.rotations import from_angles, from_heading

PLACES = [(0.0, 10.0, 179.9999), (1.0, 10.0, -180.0), (3.0, 10.0, -179.9998)]
METRES = 109_639.4
"""To a degree of longitude at 10 degrees of latitude."""


def write(path, names, rows):
    lines = [",".join(names), *(",".join(str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines))
    return path


def test_all_columns(tmp_path) -> None:
    others = ("height", "vn", "ve", "vd", "roll", "pitch", "heading", "value", "sigma")
    names = ["time", "lat", "lon", *others]
    own = (50.0, 1.0, 10.0, -0.5, 1.0, -2.0, 90.0)
    rows = [(*place, *own, value, 0.1) for place, value in zip(PLACES, (1, "", 3), strict=True)]
    said = read_ins_file(write(tmp_path / "ins.csv", names, rows), 0.0)
    assert said.time.tolist() == [0.0, 1.0, 3.0]
    assert said.has_attitude
    assert np.diff(said.solution[:, 1]) == pytest.approx(np.radians([1e-4, 2e-4]))
    assert said.solution[0, 2:6].tolist() == [50.0, 1.0, 10.0, -0.5]
    assert said.solution[0, 6:] == pytest.approx(from_angles(*np.radians([1.0, -2.0, 90.0])))
    assert said.value == pytest.approx([1.0, np.nan, 3.0], nan_ok=True)
    assert said.sigma == pytest.approx(0.1)


def test_positions_alone(tmp_path) -> None:
    path = write(tmp_path / "ins.csv", ("time", "latitude", "longitude"), PLACES)
    said = read_ins_file(path, 30.0)
    assert not said.has_attitude
    assert (said.value, said.sigma) == (None, None)
    assert said.solution[:, 2] == pytest.approx(30.0)
    assert said.solution[:, 3:6] == pytest.approx(
        np.tile([0.0, 1e-4 * METRES, 0.0], (3, 1)), rel=1e-3, abs=1e-9
    )
    assert said.solution[:, 6:] == pytest.approx(np.tile(from_heading(np.pi / 2), (3, 1)))


def test_units_that_the_header_names(tmp_path) -> None:
    names = (
        "time[ms] latitude[rad] longitude(rad) height[ft] vn[kn] ve[km/h] roll pitch heading[rad]"
    )
    rows = [
        (1000.0 * t, *np.radians([lat, lon]), 1000.0, 36.0, 36.0, 1.0, 0.0, np.pi / 2)
        for t, lat, lon in PLACES
    ]
    said = read_ins_file(
        write(tmp_path / "ins.csv", [*names.split(), "value[mGal]"], [(*r, 1) for r in rows]), 0.0
    )
    assert said.time.tolist() == [0.0, 1.0, 3.0]
    assert np.degrees(said.solution[0, :2]) == pytest.approx(PLACES[0][1:])
    assert said.solution[0, 2:5] == pytest.approx([304.8, 18.52, 10.0])
    assert said.solution[0, 6:] == pytest.approx(from_angles(*np.radians([1.0, 0.0, 90.0])))
    assert said.unit == "mGal"


def test_a_correction_of_the_ins_is_no_error(tmp_path) -> None:
    rows = [(0.0, 10.0, 20.0), (0.01, 10.0, 20.0), (0.02, 10.1, 20.0)]
    read_ins_file(write(tmp_path / "ins.csv", ["time", "latitude", "longitude"], rows), 0.0)


@pytest.mark.parametrize(
    ("names", "rows", "words"),
    [
        ("time latitude longitude roll", [(*p, 0) for p in PLACES], "has roll but not all of"),
        ("time latitude longitude vn", [(*p, 0) for p in PLACES], "has velocity_north but not"),
        ("latitude longitude", [p[1:] for p in PLACES], "has no column 'time'"),
        ("time latitude longitude", PLACES[:2], "needs at least 3 rows, has 2"),
        ("time latitude longitude", PLACES[::-1], r"line 3 \(1 s\) is not later"),
        ("time latitude longitude heading", [(*p, 400) for p in PLACES], "must be -360 to 360"),
        (
            "time latitude longitude",
            [(1e3 * (1.7e9 + t), *p) for t, *p in PLACES],
            r"time in line 2 is 1.7e\+12 s, must be 0 to 2147483648; a header time\[ms\]",
        ),
        (
            "time latitude longitude",
            [(t - 9, *p) for t, *p in PLACES],
            "line 2 is -9 s, must be 0",
        ),
        (
            "time latitude longitude",
            [("2016-12-31T23:59:60Z", *p) for _, *p in PLACES],
            "not a number or a date and time by ISO 8601 that there is",
        ),
        (
            "time latitude longitude",
            [(0.0, 0.0, 0.0), *[(t + 1, *p) for t, *p in PLACES]],
            r"line 3 are 19\d{3}\.\d km from those 1 s before, must be at most 101.0 km",
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, names, rows, words) -> None:
    path = write(tmp_path / "ins.csv", names.split(), rows)
    with pytest.raises(InputError, match=words) as caught:
        read_ins_file(path, 0.0)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def voyage(tmp_path, speed=1.0, angle=1.0, east=1.0):
    """Write a voyage of 10 m/s round a bend, with velocity and heading in other units."""
    heading = np.radians(np.linspace(20.0, 200.0, 100))
    velocity = 10.0 * np.column_stack([np.cos(heading), np.sin(heading)])
    moved = np.cumsum(velocity, axis=0) / 111e3
    rows = [
        (k, 0.01 + n, 20.0 + e, speed * v, east * speed * w, 0.0, 0.0, angle * h)
        for k, ((n, e), (v, w), h) in enumerate(
            zip(moved, velocity, np.degrees(heading), strict=True)
        )
    ]
    names = ["time", "latitude", "longitude", "vn", "ve", "roll", "pitch", "heading"]
    return write(tmp_path / "ins.csv", names, rows)


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"speed": 3600.0 / 1852.0}, "1.94 times as large.*velocity_north.kn"),
        ({"speed": 3.6}, "3.6 times as large"),
        ({"east": -1.0}, "or of another direction"),
        ({"angle": np.pi / 180.0}, "write heading.rad"),
    ],
)
def test_another_unit_that_is_not_said_is_noticed(tmp_path, other, words) -> None:
    read_ins_file(voyage(tmp_path), 0.0)
    with pytest.raises(InputError, match=words):
        read_ins_file(voyage(tmp_path, **other), 0.0)
