"""`isogal match` of any track: a result, or one line; never a traceback."""

import json
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.command_line import answer, call
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.figures import style
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.tracks.bank import TrackMatcher

HALF = 12e3
NORTH, EAST = (math.radians(1.0) * metre for metre in metres_per_radian(ORIGIN[0]))


SHAPES = {
    "straight": lambda step: (12.0 * step, 9.0 * step),
    "repeated": lambda step: (84.0 * (step // 7), 63.0 * (step // 7)),
    "standing": lambda step: (0.0 * step, 0.0 * step),
    "loop": lambda step: (2e3 * np.sin(0.05 * step), 2e3 * np.cos(0.05 * step)),
    "gap": lambda step: (5.0 * step, np.where(step > step.max() / 2, 4e3, -4e3)),
    "there and back": lambda step: (1e3 - 100.0 * np.abs(step % 20 - 10), 1.0 * step),
}
READINGS = {
    "true": lambda true, random: true + random.normal(0.0, 1.0, true.size),
    "constant": lambda true, random: np.full(true.size, 3.0),
    "noise": lambda true, random: random.normal(0.0, 30.0, true.size),
    "huge": lambda true, random: np.full(true.size, 1e6),
    "one huge": lambda true, random: np.where(np.arange(true.size) == true.size // 2, 1e6, true),
    "none": lambda true, random: np.where(np.arange(true.size) < 3, true, np.nan),
}
OFF = {"on": 0.0, "one off": 1.0, "half off": 2.0}


@pytest.fixture(scope="module")
def map_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("any") / "map.nc"
    write_netcdf(field_map_of(wavy, half=HALF, step=500.0), path)
    return path


def write_track(path, shape, count, readings, off):
    random = np.random.default_rng(count)
    north, east = (np.asarray(axis, dtype=float) for axis in SHAPES[shape](np.arange(count)))
    true = 1e5 * wavy(north, east)
    value = READINGS[readings](true, random)
    if off == "one off":
        north = np.where(np.arange(count) == count // 3, 3.0 * HALF, north)
    if off == "half off":
        east = east - east.mean() + HALF
    # the navigator was 600 m off
    latitude, longitude = np.degrees(ORIGIN[0]) + (north + 600.0) / NORTH, east / EAST
    rows = [
        f"{10 * i},{a:.9f},{np.degrees(ORIGIN[1]) + o:.9f},{'' if np.isnan(v) else f'{v:.6g}'}"
        for i, (a, o, v) in enumerate(zip(latitude, longitude, value, strict=True))
    ]
    path.write_text("\n".join(["time,latitude,longitude,value", *rows]) + "\n")


def words_for(map_file, track):
    words = ("match", "--map", map_file, "--track", track)
    return (*words, "--track-unit", "mGal", "--sensor-sigma", "1mGal")


@settings(
    max_examples=1,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@example("there and back", 120, "true", "on", "all", ())
@example("there and back", 230, "constant", "one off", "all", ())
@example("repeated", 90, "noise", "half off", "30", ("--velocity-sigma", 0.5))
@example("standing", 200, "huge", "on", "all", ("--chain",))
@example("straight", 2, "true", "on", "30", ())
@given(
    shape=st.sampled_from(sorted(SHAPES)),
    count=st.sampled_from([3, 5, 31, 62]),
    readings=st.sampled_from(sorted(READINGS)),
    off=st.sampled_from(sorted(OFF)),
    length=st.sampled_from(["4", "30", "all"]),
    more=st.sampled_from([(), ("--chain",), ("--velocity-sigma", 0.5)]),
)
def test_any_track_gives_a_result_or_one_line(
    map_file, tmp_path, shape, count, readings, off, length, more
):
    write_track(tmp_path / "track.csv", shape, count, readings, off)
    words = words_for(map_file, tmp_path / "track.csv")
    options = ("--batch-length", length, "--prior-sigma", 1000, *more)
    status, out, err = call(*words, *options, "--json")
    assert "Traceback" not in err
    if status:
        assert (status, out) == (2, "")
        assert err.count("\n") == 1 and err.startswith("isogal: ")
        return
    fixes = json.loads(out)
    assert fixes
    for fix in fixes:
        assert (fix["status"] == "fix") == (fix["reason"] is None)
        # what ends in an exception is a defect, even if it costs one batch only
        assert "the matcher failed" not in (fix["reason"] or "")
        if fix["status"] == "fix":
            widest = np.linalg.eigvalsh(fix["covariance_enu"])[-1]
            assert 0.0 < math.sqrt(widest) <= 1000.0
        name = "aided" if "--chain" in more else "with_prior"
        assert np.linalg.eigvalsh(fix[f"{name}_covariance_enu"])[0] > 0.0


def test_a_matcher_that_raises_declines_its_batch_and_is_counted(map_file, tmp_path, monkeypatch):
    write_track(tmp_path / "track.csv", "straight", 90, "true", "on")
    match, calls = TrackMatcher.match, []

    def raising(self, batch, field_map, memory):
        calls.append(memory)
        if len(calls) % 3 == 1:  # the first batch: there is no memory yet
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        return match(self, batch, field_map, memory)

    monkeypatch.setattr(TrackMatcher, "match", raising)
    monkeypatch.setattr(style, "png", lambda _: b"not drawn")
    out = tmp_path / "fixes.json"
    said = answer(*words_for(map_file, tmp_path / "track.csv"), "--prior-sigma", 1000,
                  "--out", out, "--report", tmp_path / "report")  # fmt: skip
    first, *others = json.loads(out.read_text())
    reason = "the matcher failed: LinAlgError: Matrix is not positive definite ("
    assert first["reason"].startswith(reason)
    assert calls[1] is None
    assert reason in (tmp_path / "report" / "report.html").read_text()
    assert ["failed" in (fix["reason"] or "") for fix in others] == [False, False]
    assert " of 3 batches; the matcher failed on 1 of them" in said


def test_velocity_and_attitude_of_an_ins_are_said_not_to_be_used(map_file, tmp_path):
    path = tmp_path / "ins.csv"
    write_track(path, "straight", 40, "true", "on")
    words = (*words_for(map_file, path), "--matcher", "tercom", "--json")
    plain = answer(*words)
    header, *rows = path.read_text().splitlines()
    rows = [f"{row},1.2,0.9,37" for row in rows]
    path.write_text("\n".join([f"{header},velocity_north,velocity_east,heading", *rows]) + "\n")
    status, out, err = call(*words)
    assert (status, out) == (0, plain)
    assert "velocity_north, velocity_east, heading not used" in err
