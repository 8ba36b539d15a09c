"""`isogal match` with several fields along one track, and with a gradiometer."""

import json

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.command_line import answer, refusal
from helpers.tracks import field_of, made_track, squared_distance
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.potential import derivatives

LIMIT = 13.8
"""99.9 % of chi-square with 2 degrees of freedom."""
COUNT = 40
ERROR = (500.0, -400.0)
COMPONENTS = ("nn", "ne", "nd", "ee", "ed")


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """A folder with maps of the disturbance (mGal) and of the magnetic anomaly (nT), and a track
    with readings of both and of a gradiometer 500 m above; and where it really ends (rad)."""
    folder = tmp_path_factory.mktemp("survey")
    gravity = field_of("disturbance", sigma=1e-6, correlation_length=2000.0)
    turned = field_map_of(lambda north, east: 1e6 * wavy(-east + 7e3, north))
    anomaly = FieldMap(
        turned.latitude, turned.longitude, turned.values, "nT", "magnetic_anomaly", file_unit="nT"
    )
    write_netcdf(gravity, folder / "gravity.nc")
    write_netcdf(anomaly, folder / "magnetic.nc")
    track, latitude, longitude = made_track(gravity, COUNT, error=ERROR)
    random = np.random.default_rng(4)
    tensor = derivatives(gravity, COMPONENTS, height=500.0).value(latitude, longitude)
    columns = {
        "time": track.time,
        "latitude": np.degrees(track.latitude),
        "longitude": np.degrees(track.longitude),
        "value": track.value * 1e5,
        "tmi": anomaly.value(latitude, longitude) + 2.0 * random.standard_normal(COUNT),
    }
    for name, one in zip(COMPONENTS, tensor.T, strict=True):
        columns[f"t_{name}"] = one * 1e9 + random.standard_normal(COUNT)
    rows = np.stack(list(columns.values()), axis=1)
    header = ",".join(columns)
    np.savetxt(folder / "track.csv", rows, fmt="%.10g", delimiter=",", header=header, comments="")
    return folder, (latitude[-1], longitude[-1])


def words(folder, *more):
    return (
        "match", "--map", folder / "gravity.nc", "--track", folder / "track.csv",
        "--prior-sigma", 700, "--batch-length", "all", "--json",
        "--set", "matcher.options.trust=1", *more,
    )  # fmt: skip


def gravity(folder, *more):
    told = ("--track-unit", "mGal", "--sensor-sigma", "1mGal", "--map-sigma", "0.1mGal")
    return words(folder, *told, "--bias-sigma", 0, *more)


def also(folder, more="sensor-sigma=2nT,map-sigma=1nT,bias-sigma=0"):
    return "--also", f"map={folder / 'magnetic.nc'},column=tmi,{more}"


def spread(fix):
    return float(np.linalg.det(fix["covariance_enu"]))


def test_two_fields_are_better_than_one(survey):
    folder, place = survey
    (alone,) = json.loads(answer(*gravity(folder)))
    (both,) = json.loads(answer(*gravity(folder), *also(folder)))
    assert squared_distance(both, *place) < LIMIT
    assert spread(both) < 0.5 * spread(alone)
    assert set(both["tmi_estimated"]) == set(both["estimated"])
    assert both["tmi_estimated"]["map_sigma"] == pytest.approx(1.0, rel=0.5)
    assert "tmi_estimated" not in alone


def test_another_column_is_the_same_as_value(survey, tmp_path):
    folder, _ = survey
    renamed = tmp_path / "renamed.csv"
    renamed.write_text((folder / "track.csv").read_text().replace("value", "Gravity", 1))
    options = gravity(folder)
    moved = [renamed if one == folder / "track.csv" else one for one in options]
    assert answer(*moved, "--column", "gravity") == answer(*options)


def test_map_errors_of_one_potential(survey):
    folder, place = survey
    keys = "--height", 500, "--map-height", 0, "--sensor-sigma", "1E", "--map-sigma", "5E"
    tensor = *words(folder), "--gradients", "nn,ee,ed", "--map-correlation-length", 1000, *keys
    (together,) = json.loads(answer(*tensor, "--one-potential"))
    (alone,) = json.loads(answer(*tensor))
    assert squared_distance(together, *place) < LIMIT
    assert spread(together) != pytest.approx(spread(alone), rel=1e-3)


def test_a_gradiometer_that_is_tilted(survey):
    """By 20 mrad about north and east, and with offsets, of which nobody has said anything."""
    folder, place = survey
    header = (folder / "track.csv").read_text().splitlines()[0]
    keys = "--height", 500, "--map-height", 0, "--sensor-sigma", "1E", "--map-sigma", "1E"
    tensor = *words(folder), "--gradients", "nn,ne,nd,ee,ed", *keys
    wrong = np.loadtxt(folder / "track.csv", delimiter=",", skiprows=1)
    for name, more in (("t_nd", 60.0), ("t_ed", -60.0), ("t_nn", 15.0)):
        wrong[:, header.split(",").index(name)] += more
    bad = folder / "tilted.csv"
    np.savetxt(bad, wrong, fmt="%.10g", delimiter=",", header=header, comments="")
    tilted = [bad if word == folder / "track.csv" else word for word in tensor]
    told = "--tilt-sigma", 2e-2, "--offset-sigma", 20
    (fix,) = json.loads(answer(*tilted, *told))
    assert squared_distance(fix, *place) < LIMIT
    (untold,) = json.loads(answer(*tilted, "--tilt-sigma", 0))
    # a tilt that may not be is taken for noise, sixty times what is told: more than any model has
    assert spread(untold) > spread(fix)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--also", "map=a.nc"), "column must be given"),
        (("--also", "map=a.nc,colum=tmi"), "'colum=tmi' must be KEY=VALUE"),
        (("--also", "map=a.nc,column=tmi,height=low"), "height=low: Invalid value for '--hei"),
        (("--also", "map=a.nc,column=tmi,column=tmi"), "at most once"),
        (("--gradients", "nn", "--reduction", "total"), "--reduction: does not go with"),
        (("--column", "tmj"), "has no column 'tmj' (is it 'tmi'?)"),
        (("--gradients", "nn", "--spacing", 500), "--spacing: does not go with --gradients"),
        (("--one-potential",), "--one-potential: goes with --gradients"),
        (("--gradients", "nn,nn"), "components: each once"),
        (("--gradients", "nn", "--height", -5, "--map-height", 0), "below the map's level"),
    ],
)
def test_bad_input_is_one_line(survey, options, said):
    folder, _ = survey
    assert said in refusal(*words(folder), *options)
