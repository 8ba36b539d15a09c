"""Track and map of `isogal match`: units, offsets, bags, reference tracks."""

import json
import re
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from helpers.bags import FIX, READING, position, reading, write_bag
from helpers.command_line import answer, call, refusal
from helpers.tracks import field_of, made_track, squared_distance, write_csv
from isogal.earth.gravity import normal_gravity
from isogal.maps.continuation.blocks import continued
from isogal.maps.formats.netcdf_writing import write_netcdf

LIMIT = 13.8
"""99.9 % of chi-square with 2 degrees of freedom."""


def astray(field_map, sigma):
    """The track of `files`, and its true latitude and longitude."""
    return made_track(field_map, error=(700.0, -500.0), sigma=sigma)


def consistent(fixes, latitude, longitude, most=LIMIT):
    """Whether fixes of 30 readings each are at the true places."""
    return all(
        squared_distance(fix, latitude[row], longitude[row]) < most
        for fix, row in zip(fixes, (29, 59), strict=False)
    )


def test_sigmas_are_in_the_unit_of_the_track(files, tmp_path):
    """Readings in mGal against a map in mGal, and against one in m/s² with --track-unit mGal or a
    header that says so."""
    map_file, track_file, sigma, *_ = files["disturbance"]
    field_map = field_of("disturbance")
    track = astray(field_map, sigma)[0]
    milligal = write_csv(tmp_path / "mgal.csv", track, factor=1e-5)
    in_milligal = tmp_path / "mgal.nc"
    write_netcdf(replace(field_map, values=field_map.values * 1e5), in_milligal)
    with netCDF4.Dataset(in_milligal, "a") as dataset:
        dataset.variables["disturbance"].units = "mGal"

    def fixes(map_, recorded, factor, *options):
        sigmas = zip(("sensor", "map", "bias"), (factor, 2 * factor, 3 * factor), strict=True)
        words = [word for name, value in sigmas for word in (f"--{name}-sigma", value)]
        words += ["--matcher", "pmht-paper"]
        return json.loads(
            answer("match", "--map", map_, "--track", recorded, *words, "--json", *options)
        )

    said = tmp_path / "said.csv"
    said.write_text(milligal.read_text().replace(",value", ",value[mGal]"))
    assert "[mGal]" in said.read_text()
    expected = fixes(map_file, track_file, 1e-5)
    for found in (
        fixes(map_file, said, 1.0),
        fixes(in_milligal, milligal, 1.0),
        fixes(map_file, milligal, 1.0, "--track-unit", "mGal"),
    ):
        for fix, wanted in zip(found, expected, strict=True):
            covariance = wanted["covariance_enu"][0]
            assert fix["covariance_enu"][0] == pytest.approx(covariance, rel=1e-3)
            assert fix["latitude"] == pytest.approx(wanted["latitude"], abs=1e-6)


def test_the_maps_error_is_learnt_from_reference_tracks(tmp_path):
    """The map has an error of 30 nT over 2 km and does not say so; two tracks with true positions
    show it, and the fix is then consistent."""
    field_map = field_of("magnetic_anomaly")
    cells = 1000.0 / field_map.cell_size_m(0.6)[0]
    error = gaussian_filter(np.random.default_rng(5).normal(size=field_map.values.shape), cells)
    wrong = replace(field_map, values=field_map.values + 30.0 * error / error.std())
    write_netcdf(wrong, tmp_path / "map.nc")
    columns = "time,latitude,longitude,value"
    references = []
    for k, start in enumerate([(-20e3, -12e3), (0.0, -25e3)]):
        known, _, _ = made_track(field_map, count=150, sigma=1.0, seed=k, start=start)
        references += ["--reference", write_csv(tmp_path / f"r{k}.csv", known, columns)]
    track, latitude, longitude = made_track(field_map, error=(700.0, -500.0), sigma=1.0, seed=9)
    words = ["match", "--map", tmp_path / "map.nc", "--sensor-sigma", 1.0, "--batch-length", 60]
    words += ["--track", write_csv(tmp_path / "t.csv", track, columns), "--json"]
    status, out, said = call(*words, *references)
    assert status == 0
    assert 15.0 < float(re.search(r"300 readings: map error (\S+)", said)[1]) < 60.0
    assert "taken as exact" not in said
    (fix,) = json.loads(out)
    assert squared_distance(fix, latitude[-1], longitude[-1]) < LIMIT
    assert "none.csv: cannot be read" in refusal(*words, "--reference", tmp_path / "none.csv")


def test_a_bag_is_reduced_with_the_latitude_of_its_navigator(files, tmp_path):
    """The navigator was 700 m too far north: its normal gravity is 0.56 mGal too small."""
    map_file, _, sigma, latitude, longitude = files["disturbance"]
    track = astray(field_of("disturbance"), sigma)[0]
    reduced = track.value + normal_gravity(latitude) - normal_gravity(track.latitude)
    messages = []
    for k, time in enumerate(track.time):
        place = np.degrees([track.latitude[k], track.longitude[k]])
        messages.append(("/nav/fix", FIX, position(time, *place)))
        messages.append(("/gravimeter/disturbance", READING, reading(time, reduced[k], sigma**2)))
    write_bag(tmp_path / "bag" / "bag_0.mcap", *messages)
    words = ("match", "--matcher", "pmht-paper", "--track", tmp_path / "bag", "--map")
    told = (*words, map_file, "--map-sigma", 1e-7, "--json")
    fixes = json.loads(answer(*told))
    assert consistent(fixes, latitude, longitude)
    wider, _ = json.loads(answer(*told, "--sensor-sigma", "3mGal"))
    assert np.trace(wider["covariance_enu"]) > 3.0 * np.trace(fixes[0]["covariance_enu"])
    message = refusal(*words, files["gravity"][0])
    assert "has readings of disturbance, and the map is of gravity" in message
    message = refusal(*words, map_file, "--fix-topic", "ins/fix")
    assert "has no message on 'ins/fix'" in message


def test_the_map_is_continued_to_the_height_of_the_readings(files, tmp_path):
    """1 km above the map its waves of some 6 km have a third of their height."""
    map_file, _, sigma, *_ = files["disturbance"]
    above = continued(field_of("disturbance"), 1000.0, 0.0)
    track, *place = astray(above, 0.1 * sigma)
    path = write_csv(tmp_path / "above.csv", track)
    words = ("match", "--map", map_file, "--track", path, "--sensor-sigma", 0.1 * sigma)
    words = (*words, "--matcher", "pmht-paper", "--map-sigma", 1e-7)
    fixes = json.loads(answer(*words, "--height", 1000, "--map-height", 0, "--json"))
    assert consistent(fixes, *place)
    as_it_is = json.loads(answer(*words, "--json"))
    assert not consistent(as_it_is[:1], *place, most=3.0 * LIMIT)
    message = refusal(*words, "--height", 1000)
    assert "does not say what level its values hold on; give --map-height" in message
    assert "goes with --height" in refusal(*words, "--map-height", 0)


def test_lines_stations_and_all_readings_at_once(files, tmp_path):
    map_file, track_file, *_ = files["disturbance"]
    header, *rows = (row.partition(",")[2] for row in track_file.read_text().splitlines())
    named = [f"{'AB'[k >= 30]},{row}" for k, row in enumerate(rows)]  # and without times
    path = tmp_path / "lines.csv"
    path.write_text("\n".join([f"line,{header}", *named]))
    out = tmp_path / "fixes.json"
    words = ("match", "--map", map_file, "--track", path, "--sensor-sigma", "1mGal")
    words = (*words, "--batch-length", "all", "--spacing", "300", "--out", out)
    text = answer(*words, "--out", out.with_suffix(".csv"))
    found = json.loads(out.read_text())
    assert [one["line"] for one in found] == ["A", "B"]
    assert all(one["readings"] <= 30 and one["estimated"]["map_sigma"] >= 0.0 for one in found)
    assert "line A" in text
    assert "readings used, 0 left out" in text
    assert "estimated_map_sigma" in out.with_suffix(".csv").read_text()
