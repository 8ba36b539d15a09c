"""`isogal match` from files to files: CSV and bag in, every format out, options, and one line for
bad input."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from helpers.bags import FIX, READING, position, reading, write_bag
from helpers.tracks import FIELDS, field_of, made_track, write_csv
from isogal import plugins
from isogal.cli.main import app
from isogal.earth.frames import horizontal_difference
from isogal.earth.gravity import normal_gravity
from isogal.maps.formats.netcdf import write_netcdf

ISOGAL = Path(sys.executable).with_name("isogal")


def call(capsys, *arguments) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exit_:
        app(["match", *(str(a) for a in arguments)])
    captured = capsys.readouterr()
    return int(exit_.value.code or 0), captured.out, captured.err


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Map and track of each quantity; the navigator was 700 m too far north and 500 m too far
    west."""
    folder = tmp_path_factory.mktemp("match")
    result = {}
    for quantity in FIELDS:
        field_map = field_of(quantity)
        sigma = 1e-5 * FIELDS[quantity][1]
        track, latitude, longitude = made_track(field_map, error=(700.0, -500.0), sigma=sigma)
        write_netcdf(field_map, folder / f"{quantity}.nc")
        write_csv(folder / f"{quantity}.csv", track)
        result[quantity] = (
            folder / f"{quantity}.nc",
            folder / f"{quantity}.csv",
            sigma,
            latitude,
            longitude,
        )
    return result


@pytest.mark.parametrize("quantity", FIELDS)
def test_track_to_json(files, capsys, tmp_path, quantity):
    map_, track, sigma, latitude, longitude = files[quantity]
    out = tmp_path / "fixes.json"
    status, _, error = call(
        capsys, "--map", map_, "--track", track, "--sensor-sigma", sigma, "--out", out
    )
    assert status == 0
    assert "the map does not say how wrong it is" in error
    fixes = json.loads(out.read_text())
    assert [fix["time"] for fix in fixes] == [295.0, 595.0]
    for fix, row in zip(fixes, (29, 59), strict=True):
        assert set(fix) == {"time", "latitude", "longitude", "covariance_enu", "status", "reason"}
        assert fix["status"] == "fix"
        position = np.radians([fix["latitude"], fix["longitude"]])
        apart = horizontal_difference(*position, latitude[row], longitude[row])[
            ::-1
        ]  # east, north
        assert apart @ np.linalg.solve(fix["covariance_enu"], apart) < 13.8  # 99.9 %
        assert np.sqrt(np.trace(fix["covariance_enu"])) < 200.0


def test_all_formats_say_the_same_and_json_goes_to_stdout(files, capsys, tmp_path):
    map_, track, sigma, *_ = files["magnetic_anomaly"]
    outs = [tmp_path / f"fixes.{suffix}" for suffix in ("json", "csv", "geojson")]
    options = [x for out in outs for x in ("--out", out)]
    status, printed, _ = call(
        capsys,
        "--map",
        map_,
        "--track",
        track,
        "--sensor-sigma",
        sigma,
        "--map-sigma",
        0.5,
        "--json",
        *options,
    )
    assert status == 0
    fixes = json.loads(outs[0].read_text())
    assert json.loads(printed) == fixes
    rows = list(csv.DictReader(outs[1].open()))
    assert [float(row["covariance_en"]) for row in rows] == [
        fix["covariance_enu"][0][1] for fix in fixes
    ]
    points = [
        feature["geometry"]["coordinates"]
        for feature in json.loads(outs[2].read_text())["features"]
    ]
    assert points == [[fix["longitude"], fix["latitude"]] for fix in fixes]


def test_sigmas_are_in_the_maps_own_unit(files, capsys, tmp_path):
    """The same track in mGal against the same map in mGal, and told to be in mGal against the map
    in m/s²."""
    _, _, sigma, *_ = files["disturbance"]
    field_map = field_of("disturbance")
    track, _, _ = made_track(field_map, error=(700.0, -500.0), sigma=sigma)
    milligal = write_csv(tmp_path / "mgal.csv", track, factor=1e-5)
    in_milligal = field_map.__class__(
        field_map.latitude, field_map.longitude, field_map.values * 1e5, "m/s²", "disturbance"
    )
    write_netcdf(in_milligal, tmp_path / "mgal.nc")
    import netCDF4

    with netCDF4.Dataset(tmp_path / "mgal.nc", "a") as dataset:
        dataset.variables["disturbance"].units = "mGal"
    options = ["--sensor-sigma", 1.0, "--map-sigma", 2.0, "--bias-sigma", 3.0, "--json"]
    _, own, _ = call(capsys, "--map", tmp_path / "mgal.nc", "--track", milligal, *options)
    _, told, _ = call(
        capsys,
        "--map",
        files["disturbance"][0],
        "--track",
        milligal,
        "--track-unit",
        "mGal",
        *options,
    )
    si = ["--sensor-sigma", 1e-5, "--map-sigma", 2e-5, "--bias-sigma", 3e-5, "--json"]
    _, expected, _ = call(
        capsys, "--map", files["disturbance"][0], "--track", files["disturbance"][1], *si
    )
    for text in (own, told):
        for found, wanted in zip(json.loads(text), json.loads(expected), strict=True):
            assert found["covariance_enu"][0] == pytest.approx(
                wanted["covariance_enu"][0], rel=1e-3
            )
            assert found["latitude"] == pytest.approx(wanted["latitude"], abs=1e-6)


def test_offset_is_added_to_the_map(files, capsys, tmp_path):
    map_, plain, sigma, *_ = files["height"]
    track, _, _ = made_track(field_of("height"), error=(700.0, -500.0), sigma=sigma)
    from dataclasses import replace

    offset = 40.0 * np.sin(np.arange(60.0))
    shifted = write_csv(
        tmp_path / "t.csv",
        replace(track, value=track.value + offset, offset=offset),
        "time,latitude,longitude,value,sigma,offset",
    )
    _, expected, _ = call(
        capsys, "--map", map_, "--track", plain, "--sensor-sigma", sigma, "--json"
    )
    _, found, _ = call(capsys, "--map", map_, "--track", shifted, "--json")
    for a, b in zip(json.loads(found), json.loads(expected), strict=True):
        assert a["latitude"] == pytest.approx(b["latitude"], abs=1e-6)
        assert a["covariance_enu"][1] == pytest.approx(b["covariance_enu"][1], rel=1e-3)


def test_normal_gravity_in_the_offset_may_be_that_of_another_latitude(files, capsys, tmp_path):
    """Normal gravity at the navigator's latitude, 700 m off, or at the true one: without
    --reduction the fix is honest about both."""
    map_, _, sigma, latitude, longitude = files["disturbance"]
    track, _, _ = made_track(field_of("disturbance"), error=(700.0, -500.0), sigma=sigma)
    from dataclasses import replace

    truth = normal_gravity(latitude, 100.0)
    for name, offset in (("own", normal_gravity(track.latitude, 100.0)), ("true", truth)):
        columns = "time,latitude,longitude,value,offset"
        path = write_csv(
            tmp_path / f"{name}.csv",
            replace(track, value=track.value + truth, offset=offset),
            columns,
        )
        options = [
            "--map",
            map_,
            "--track",
            path,
            "--sensor-sigma",
            sigma,
            "--batch-length",
            60,
            "--json",
        ]
        _, out, error = call(capsys, *options)
        assert "offset holds normal gravity" in error
        assert "an unknown constant of 7.8e-06 m s-2 is allowed for" in error
        (fix,) = json.loads(out)
        apart = horizontal_difference(
            *np.radians([fix["latitude"], fix["longitude"]]), latitude[-1], longitude[-1]
        )
        assert apart[::-1] @ np.linalg.solve(fix["covariance_enu"], apart[::-1]) < 13.8  # 99.9 %
        _, told, error = call(
            capsys, *options, "--reduction", "latitude" if name == "own" else "none"
        )
        assert "normal gravity" not in error
        assert np.trace(json.loads(told)[0]["covariance_enu"]) < np.trace(fix["covariance_enu"])


def test_the_maps_error_is_learnt_from_reference_tracks(capsys, tmp_path):
    """The map has an error of 30 nT over 2 km that it does not tell; two tracks with true
    positions do, the fix is then honest."""
    from dataclasses import replace

    field_map = field_of("magnetic_anomaly")
    random = np.random.default_rng(5)
    error = gaussian_filter(
        random.normal(size=field_map.values.shape), 1000.0 / field_map.cell_size_m(0.6)[0]
    )
    wrong = replace(field_map, values=field_map.values + 30.0 * error / error.std())
    write_netcdf(wrong, tmp_path / "map.nc")
    columns = "time,latitude,longitude,value"
    references = []
    for k, start in enumerate([(-20e3, -12e3), (0.0, -25e3)]):
        known, _, _ = made_track(field_map, count=150, sigma=1.0, seed=k, start=start)
        references += ["--reference", write_csv(tmp_path / f"r{k}.csv", known, columns)]
    track, latitude, longitude = made_track(
        field_map, error=(700.0, -500.0), sigma=1.0, seed=9, count=120
    )
    path = write_csv(tmp_path / "t.csv", track, columns)
    options = [
        "--map",
        tmp_path / "map.nc",
        "--track",
        path,
        "--sensor-sigma",
        1.0,
        "--batch-length",
        120,
        "--json",
    ]
    status, out, said = call(capsys, *options, *references)
    assert status == 0
    assert 15.0 < float(re.search(r"300 readings: map error (\S+)", said)[1]) < 60.0
    assert "taken as exact" not in said
    (fix,) = json.loads(out)
    apart = horizontal_difference(
        *np.radians([fix["latitude"], fix["longitude"]]), latitude[-1], longitude[-1]
    )[::-1]
    assert apart @ np.linalg.solve(fix["covariance_enu"], apart) < 13.8  # 99.9 %
    status, _, said = call(capsys, *options, "--reference", tmp_path / "none.csv")
    assert status == 2
    assert "none.csv: cannot be read" in said


@pytest.mark.parametrize(
    ("options", "ends"),
    [
        (["--batch-length", 20], [195.0, 395.0, 595.0]),
        (["--batch-length", 20, "--stride", 10], [195.0, 295.0, 395.0, 495.0, 595.0]),
        (
            ["--set", "matcher.batch_length=50", "--set", "matcher.options.samples=256"],
            [495.0, 595.0],
        ),
        (["--matcher", "pmht-paper"], [295.0, 595.0]),
    ],
)
def test_options_of_the_matcher(files, capsys, options, ends):
    map_, track, sigma, *_ = files["disturbance"]
    status, out, _ = call(
        capsys, "--map", map_, "--track", track, "--sensor-sigma", sigma, "--json", *options
    )
    assert status == 0
    assert [fix["time"] for fix in json.loads(out)] == ends


@pytest.mark.parametrize("matcher", plugins.names(plugins.MATCHERS))
def test_every_matcher(files, capsys, matcher):
    map_, track, sigma, *_ = files["magnetic_anomaly"]
    options = [
        "--sensor-sigma",
        sigma,
        "--map-sigma",
        sigma,
        "--prior-sigma",
        800,
        "--matcher",
        matcher,
        "--json",
    ]
    status, out, _ = call(capsys, "--map", map_, "--track", track, *options)
    assert status == 0
    fixes = json.loads(out)
    assert len(fixes) == 2
    for fix in fixes:
        assert (
            (fix["status"] == "fix")
            == (fix["reason"] is None)
            == (fix["covariance_enu"] is not None)
        )
    assert any(fix["status"] == "fix" for fix in fixes)


def test_chained_batches_and_report(files, capsys, tmp_path):
    map_, track, sigma, *_ = files["disturbance"]
    options = [
        "--sensor-sigma",
        sigma,
        "--batch-length",
        20,
        "--chain",
        "--velocity-sigma",
        0.01,
        "--walk-sigma",
        50,
    ]
    status, out, _ = call(
        capsys,
        "--map",
        map_,
        "--track",
        track,
        *options,
        "--json",
        "--report",
        tmp_path / "report",
    )
    assert status == 0
    assert all("aided_latitude" in fix for fix in json.loads(out))
    assert (tmp_path / "report" / "report.html").is_file()
    status, out, _ = call(capsys, "--map", map_, "--track", track, *options)
    assert "3 fixes of 3 batches" in out


def test_a_bag_is_a_track_too(files, capsys, tmp_path):
    """Readings reduced by a navigator 700 m too far north: its normal gravity is 0.56 mGal too
    small, which the match knows."""
    map_, _, sigma, true_latitude, true_longitude = files["disturbance"]
    track, _, _ = made_track(field_of("disturbance"), error=(700.0, -500.0), sigma=sigma)
    reduced = track.value + normal_gravity(true_latitude) - normal_gravity(track.latitude)
    messages = []
    for k, time in enumerate(track.time):
        place = np.degrees([track.latitude[k], track.longitude[k]])
        messages.append(("/nav/fix", FIX, position(time, *place)))
        messages.append(("/gravimeter/disturbance", READING, reading(time, reduced[k], sigma**2)))
    write_bag(tmp_path / "bag" / "bag_0.mcap", *messages)
    status, out, _ = call(
        capsys, "--map", map_, "--track", tmp_path / "bag", "--map-sigma", 1e-7, "--json"
    )
    assert status == 0
    for fix, row in zip(json.loads(out), (29, 59), strict=True):
        place = np.radians([fix["latitude"], fix["longitude"]])
        apart = horizontal_difference(*place, true_latitude[row], true_longitude[row])[::-1]
        assert apart @ np.linalg.solve(fix["covariance_enu"], apart) < 13.8
    status, _, error = call(capsys, "--map", files["gravity"][0], "--track", tmp_path / "bag")
    assert status == 2
    assert "has readings of disturbance, and the map is of gravity" in error


BAD = {
    "no file": (["--track", "none.csv"], "none.csv: no such file or folder"),
    "no map": (["--map", "none.nc"], "none.nc: no such file or folder"),
    "suffix": (["--out", "x.txt"], "x.txt: results are written to .json, .csv, .geojson files"),
    "matcher": (["--matcher", "pmth"], "matcher.name"),
    "key": (
        ["--set", "matcher.stirde=3"],
        "unknown key 'matcher.stirde', did you mean 'matcher.stride'?",
    ),
    "section": (["--set", "route.speed=3"], "only keys that begin with matcher. count here"),
    "option": (
        ["--set", "matcher.options.sample=3"],
        "matcher.options of pmht: unknown key 'sample'",
    ),
    "length": (["--batch-length", "1"], "matcher.batch_length"),
    "prior": (["--prior-sigma", "0"], "1-sigma of the track's position error must be > 0"),
    "sensor": (["--sensor-sigma", "0"], "--sensor-sigma: must be > 0"),
    "map sigma": (["--map-sigma", "much"], "--map-sigma: must be a number or auto, not 'much'"),
    "negative map sigma": (["--map-sigma", "-1"], "matcher.map_sigma"),
    "bias": (["--bias-sigma", "-1"], "--bias-sigma: must be >= 0"),
    "unit": (["--track-unit", "nT"], "--track-unit: 'nT' does not fit a disturbance map"),
    "unknown unit": (["--track-unit", "stone"], "--track-unit: unknown unit 'stone'"),
    "wrong unit": (["--track-unit", "mGal"], "they look like m/s²: give --track-unit 'm/s²'"),
    "variable": (["--variable", "dgg"], "has no variable 'dgg'"),
    "reduction": (["--reduction", "speed"], "reduction must be one of none, latitude, velocity"),
    "no fix topic": (["--track", "."], "no MCAP file in this folder"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_ends_in_one_line(files, capsys, tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    options, message = BAD[case]
    map_, track, *_ = files["disturbance"]
    status, out, error = call(
        capsys, "--map", map_, "--track", track, "--map-sigma", "1e-6", *options
    )
    assert status == 2
    assert out == ""
    assert len(error.splitlines()) == 1
    assert message in error
    assert not list(tmp_path.iterdir())


def test_sensor_sigma_is_asked_for_where_no_one_says_it(files, capsys):
    map_, track, *_ = files["height"]
    status, _, error = call(capsys, "--map", map_, "--track", track)
    assert status == 2
    assert "has no column sigma; give --sensor-sigma" in error


def test_a_track_beside_the_map_is_refused(files, capsys, tmp_path):
    map_, track, *_ = files["disturbance"]
    far = tmp_path / "far.csv"
    lines = [line.split(",") for line in track.read_text().splitlines()]
    far.write_text(
        "\n".join(
            ",".join([a, b if b == "latitude" else str(float(b) + 0.5), *rest])
            for a, b, *rest in lines
        )
    )
    status, _, error = call(capsys, "--map", map_, "--track", far)
    assert status == 2
    assert len(error.splitlines()) == 1
    assert "has nothing at" in error or "is off the map" in error


def test_from_a_shell(files):
    """The console script, with a bad and a good call."""
    map_, track, *_ = files["disturbance"]
    done = subprocess.run(
        [ISOGAL, "match", "--map", map_, "--track", track, "--json"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)) == 2
    done = subprocess.run(
        [ISOGAL, "match", "--map", map_], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 2
    assert "--track" in done.stderr
    assert len(done.stderr.splitlines()) == 1
