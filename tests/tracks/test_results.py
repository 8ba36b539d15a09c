"""Files of results: their content and order."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.matching.interfaces import Fix
from isogal.tracks.fields import TrackField
from isogal.tracks.matching import Match
from isogal.tracks.results import as_csv, as_geojson, as_objects, in_words, write_results
from isogal.tracks.track import Track

NORTH_EAST = np.array([[100.0, 30.0], [30.0, 400.0]])


def a_match(reason=None):
    covariance = NORTH_EAST if reason is None else np.full((2, 2), np.nan)
    fix = Fix(12.5, *np.radians([-36.5, 190.0]).tolist(), covariance, reason=reason)
    place = fix.latitude - 111.0 / 6.36e6, fix.longitude
    return Match(fix, slice(0, 30), np.array([111.0, 0.0, 0.0, 0.0]), np.eye(4), place)


FIXED, DECLINED = a_match(), a_match("ambiguous: 2 places fit")


def test_keys_of_objects_with_and_without_a_fix():
    fixed, none = as_objects([FIXED, DECLINED])
    assert fixed == {
        "time": 12.5,
        "latitude": -36.5,
        "longitude": -170.0,
        "covariance_enu": [[400.0, 30.0], [30.0, 100.0]],
        "status": "fix",
        "reason": None,
        "with_prior_latitude": pytest.approx(-36.5 - 0.001, abs=3e-6),  # 111 m
        "with_prior_longitude": -170.0,
        "with_prior_covariance_enu": [[1.0, 0.0], [0.0, 1.0]],
    }
    assert list(none) == list(fixed)
    assert none["with_prior_covariance_enu"] == [[1.0, 0.0], [0.0, 1.0]]
    own = none["status"], none["covariance_enu"], none["reason"]
    assert own == ("no_fix", None, "ambiguous: 2 places fit")
    (chained,) = as_objects([replace(FIXED, chained=True)])
    assert chained == {key.replace("with_prior", "aided"): value for key, value in fixed.items()}


def test_readings_that_are_matched_again_count_once():
    """A batch without fix is matched again with the next."""
    numbers = {"readings": 30.0, "readings_left_out": 1.0, "misfit": 1.0, "places": 2.0}
    numbers |= {"probability": 0.5}
    ambiguous = replace(DECLINED, fix=replace(DECLINED.fix, diagnostics=numbers))
    both = replace(FIXED.fix, diagnostics=numbers | {"readings": 60.0, "readings_left_out": 2.0})
    track = Track(np.arange(90.0), *[np.ones(90)] * 5, "track.csv")
    fields = [TrackField("value", track, field_map=None)]
    assert "fixes: 60 readings used, 2 left out;" in "\n".join(
        in_words([ambiguous, replace(FIXED, fix=both)], fields)
    )


def test_csv_has_a_column_for_each_number():
    text = as_csv(as_objects([replace(one, chained=True) for one in (FIXED, DECLINED)]))
    fixed, none = csv.DictReader(io.StringIO(text))
    place = ["latitude", "longitude", "covariance_ee", "covariance_en", "covariance_nn"]
    assert list(fixed)[:8] == ["time", *place, "status", "reason"]
    assert list(fixed.values())[3:8] == ["400.0", "30.0", "100.0", "fix", ""]
    assert list(none.values())[3:8] == ["", "", "", "no_fix", "ambiguous: 2 places fit"]


def test_geojson_has_longitude_first_and_no_geometry_without_a_fix():
    document = json.loads(as_geojson(as_objects([FIXED, DECLINED])))
    assert document["type"] == "FeatureCollection"
    fixed, none = document["features"]
    assert fixed["geometry"] == {"type": "Point", "coordinates": [-170.0, -36.5]}
    assert fixed["properties"]["covariance_enu"] == [[400.0, 30.0], [30.0, 100.0]]
    assert none["geometry"] is None
    assert none["properties"]["reason"] == "ambiguous: 2 places fit"


def test_files_that_cannot_be_written_are_refused(tmp_path):
    says = r"results are written to .json, .csv, .geojson files, not to '.txt'"
    with pytest.raises(InputError, match=says):
        write_results([], tmp_path / "a.txt")
    (tmp_path / "a.json").write_text("")
    with pytest.raises(InputError, match="cannot be made: Not a directory"):
        write_results([], tmp_path / "a.json" / "none" / "a.json")
