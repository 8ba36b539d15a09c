"""Files of results: their content and order."""

import csv
import io
import json

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.matching.interfaces import Fix
from isogal.tracks.matching import Match
from isogal.tracks.results import as_csv, as_geojson, as_objects, write_results, writer_for

NORTH_EAST = np.array([[100.0, 30.0], [30.0, 400.0]])


def a_match(reason=None):
    covariance = NORTH_EAST if reason is None else np.full((2, 2), np.nan)
    fix = Fix(
        time=12.5,
        latitude=np.radians(-36.5),
        longitude=np.radians(190.0),
        covariance=covariance,
        reason=reason,
    )
    return Match(
        fix, slice(0, 30), np.array([111.0, 0.0, 0.0, 0.0]), np.eye(4), fix.latitude, fix.longitude
    )


FIXED, DECLINED = a_match(), a_match("ambiguous: 2 places fit")


def test_keys_of_objects_with_and_without_a_fix():
    fixed, none = as_objects([FIXED, DECLINED])
    own = ["time", "latitude", "longitude", "covariance_enu", "status", "reason"]
    with_prior = [f"with_prior_{name}" for name in own[1:4]]
    assert list(fixed) == own + with_prior
    assert fixed.pop("with_prior_latitude") == pytest.approx(-36.5 - 0.001, abs=3e-6)  # 111 m
    assert fixed.pop("with_prior_longitude") == -170.0
    assert fixed.pop("with_prior_covariance_enu") == [[1.0, 0.0], [0.0, 1.0]]
    assert none["with_prior_covariance_enu"] == [[1.0, 0.0], [0.0, 1.0]]
    assert fixed == {
        "time": 12.5,
        "latitude": -36.5,
        "longitude": -170.0,
        "covariance_enu": [[400.0, 30.0], [30.0, 100.0]],
        "status": "fix",
        "reason": None,
    }
    assert none["status"] == "no_fix"
    assert none["covariance_enu"] is None
    assert none["reason"] == "ambiguous: 2 places fit"


def test_chained_objects_hold_the_aided_position():
    entry = as_objects([FIXED], chained=True)[0]
    assert entry["aided_latitude"] == pytest.approx(
        -36.5 - 0.001, abs=3e-6
    )  # an error of 111 m north
    assert entry["aided_longitude"] == -170.0
    assert entry["aided_covariance_enu"] == [[1.0, 0.0], [0.0, 1.0]]
    assert not any(name.startswith("with_prior") for name in entry)


def test_csv_has_a_column_for_each_number():
    rows = list(csv.DictReader(io.StringIO(as_csv(as_objects([FIXED, DECLINED], chained=True)))))
    place = ["latitude", "longitude", "covariance_ee", "covariance_en", "covariance_nn"]
    names = ["time", *place, "status", "reason"]
    assert list(rows[0])[:8] == names
    assert [rows[0][name] for name in names[3:]] == ["400.0", "30.0", "100.0", "fix", ""]
    none = [rows[1][name] for name in names[3:]]
    assert none == ["", "", "", "no_fix", "ambiguous: 2 places fit"]


def test_geojson_has_longitude_first_and_no_geometry_without_a_fix():
    document = json.loads(as_geojson(as_objects([FIXED, DECLINED])))
    assert document["type"] == "FeatureCollection"
    fixed, none = document["features"]
    assert fixed["geometry"] == {"type": "Point", "coordinates": [-170.0, -36.5]}
    assert fixed["properties"]["covariance_enu"] == [[400.0, 30.0], [30.0, 100.0]]
    assert none["geometry"] is None
    assert none["properties"]["reason"] == "ambiguous: 2 places fit"


def test_files_that_cannot_be_written_are_refused(tmp_path):
    with pytest.raises(
        InputError, match=r"results are written to .json, .csv, .geojson files, not to '.txt'"
    ):
        writer_for(tmp_path / "a.txt")
    (tmp_path / "a.json").write_text("")
    with pytest.raises(InputError, match="cannot be made: Not a directory"):
        write_results([], tmp_path / "a.json" / "none" / "a.json")
