"""`isogal montecarlo` as a user runs it."""

import json
import os
import signal
import subprocess
from pathlib import Path

import pytest

from helpers.command_line import answer, refusal
from helpers.commands import command, sets, wait_for
from helpers.studies import wavy_map
from isogal.evaluation.figures import style
from isogal.maps.formats.netcdf_writing import write_netcdf

KEYS = [
    *("scenario", "matcher", "runs", "diverged", "position_error", "unaided", "bound"),
    *("nees_per_axis", "nees_all_scans", "judgement", "integrity", "fixes", "time"),
    "rms_over_time",
]


@pytest.fixture(scope="module")
def arguments(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "waves.nc"
    write_netcdf(wavy_map(), path)
    settings = (
        *("route.duration=600", "gravimeter.quantity=disturbance", "gravity.field=normal"),
        *(f"map.source={path}", "matcher.batch_length=20"),
    )
    return ["montecarlo", "--matcher", "pmht-paper", *sets(settings)]


@pytest.fixture(scope="module")
def finished(arguments, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    words = ("--runs", "3", "--workers", "1", "--out", str(out))
    assert "Mean position error" in answer(*arguments, *words)
    return out


def test_more_runs_than_records_have_numbers_are_refused(arguments, tmp_path):
    said = refusal(*arguments, "--runs", 10**11, "--out", tmp_path / "out")
    assert "--runs" in said
    assert not (tmp_path / "out").exists()


def test_what_it_writes(finished):
    document = json.loads((finished / "results.json").read_text())
    assert list(document) == KEYS
    assert document["runs"] == 3
    assert document["matcher"] == document["scenario"]["matcher"]["name"] == "pmht-paper"
    assert document["fixes"]["published"] + document["fixes"]["declined"] == 3 * 3
    assert len(document["rms_over_time"]["time"]) == len(document["rms_over_time"]["aided"]) == 11
    assert "<img" in (finished / "report.html").read_text()
    assert (finished / "position_error.png").stat().st_size > 10_000


def test_smoothed_runs(arguments, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "png", lambda _: b"not drawn")
    words = ("--runs", "2", "--workers", "1", "--out", str(tmp_path), "--smooth")
    printed = answer(*arguments, *words)
    assert "Smoothed: RMS error over bound" in printed
    found = json.loads((tmp_path / "results.json").read_text())
    assert list(found) == [*KEYS, "smoothed"]
    assert found["smoothed"]["bound"]["rms"] < found["bound"]["rms"]


def test_again_with_json_computes_nothing_and_says_the_same(arguments, finished, monkeypatch):
    monkeypatch.setattr(style, "png", lambda _: b"drawn before")
    before = json.loads((finished / "results.json").read_text())
    files = sorted(path.stat().st_mtime_ns for path in (finished / "runs").rglob("*.npz"))
    words = ("--runs", "3", "--workers", "1", "--out", str(finished), "--json")
    printed = json.loads(answer(*arguments, *words))
    assert {**printed, "time": None} == {**before, "time": None}
    assert files == sorted(path.stat().st_mtime_ns for path in (finished / "runs").rglob("*.npz"))


def test_interrupted_by_the_terminal_it_keeps_runs_and_goes_on(
    arguments, finished, tmp_path, monkeypatch
):
    words = [*arguments, "--workers", "1", "--out", str(tmp_path)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command(*words, "--runs", "600"), start_new_session=True, **pipes)
    wait_for(lambda: [*tmp_path.rglob("*.npz")] or process.poll() is not None, "a run")
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers as well
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert out == ""
    last = err.strip().splitlines()[-1]
    assert last.startswith("isogal: interrupted: ")
    assert last.endswith(f"are kept in {tmp_path / 'runs'}; the same command goes on from there")
    assert "Traceback" not in err
    monkeypatch.setattr(style, "png", lambda _: b"not drawn")
    after = json.loads(answer(*words, "--runs", "3", "--json"))
    expected = json.loads((finished / "results.json").read_text())
    assert {**after, "time": None} == {**expected, "time": None}


TRACK = Path(__file__).parents[2] / "examples" / "recorded_track" / "track.csv"
RECORDED = sets(
    (
        f"route={{track: {TRACK}}}",
        f"readings={{source: {TRACK}, column: nothing}}",
        "field=disturbance",
    )
)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--runs", "0"], "--runs"),
        (["--runs", "2", "--workers", "2", "--scheduler", "tcp://h:1"], "give one of them"),
        (["--runs", "2", "--set", "map.source=/nowhere.nc"], "/nowhere.nc"),
        (["--runs", "2", "--set", "gravimeter.sigma=-1"], "gravimeter.sigma"),
        # before a map is made, which may take long
        (["--runs", "2", *RECORDED, "--set", "map.source=/nowhere.nc"], "has no column nothing"),
    ],
)
def test_bad_input_is_one_line(arguments, tmp_path, words, message):
    assert message in refusal(*arguments, "--out", tmp_path / "out", *words)
    assert not (tmp_path / "out").exists()
