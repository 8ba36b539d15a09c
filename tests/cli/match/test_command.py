"""`isogal match` from files to files: results in every format, every matcher, and one line for bad
input."""

import json

import numpy as np
import pytest

from helpers.command_line import answer, call, refusal
from helpers.tracks import squared_distance
from isogal import plugins
from isogal.evaluation.figures import style

LIMIT = 13.8
"""99.9 % of chi-square with 2 degrees of freedom."""


def words_for(files, quantity):
    """The options that a match of this quantity needs."""
    map_file, track, sigma, *_ = files[quantity]
    return ("match", "--map", map_file, "--track", track, "--sensor-sigma", sigma)


@pytest.mark.parametrize(("quantity", "matcher"), [("height", "pmht-paper"), ("gravity", "pmht")])
def test_fixes_in_all_formats_are_as_near_to_the_truth_as_they_say(
    files, tmp_path, quantity, matcher
):
    outs = [tmp_path / f"fixes.{suffix}" for suffix in ("json", "csv", "geojson")]
    options = ["--json", *(word for out in outs for word in ("--out", out))]
    status, printed, said = call(*words_for(files, quantity), *options, "--matcher", matcher)
    assert status == 0
    assert "the map does not say how wrong it is" in said
    fixes = json.loads(outs[0].read_text())
    assert json.loads(printed) == fixes
    assert len(outs[1].read_text().splitlines()) == 1 + len(fixes)
    assert len(json.loads(outs[2].read_text())["features"]) == len(fixes)
    assert [fix["time"] for fix in fixes] == [295.0, 595.0]
    latitude, longitude = files[quantity][3:]
    for fix, row in zip(fixes, (29, 59), strict=True):
        learnt = {"map_sigma", "map_correlation_length", "offset"}
        assert matcher != "pmht" or set(fix["estimated"]) >= learnt
        assert fix["status"] == "fix"
        assert squared_distance(fix, latitude[row], longitude[row]) < LIMIT
        sigma = np.sqrt(np.trace(fix["covariance_enu"]))
        assert sigma < (200.0 if matcher == "pmht" else 250.0)


@pytest.mark.parametrize("matcher", plugins.names(plugins.MATCHERS))
def test_every_matcher(files, matcher):
    sigma = files["magnetic_anomaly"][2]
    options = ("--map-sigma", sigma, "--prior-sigma", 800, "--matcher", matcher, "--json")
    fixes = json.loads(answer(*words_for(files, "magnetic_anomaly"), *options))
    assert len(fixes) == 2
    for fix in fixes:
        published = fix["status"] == "fix"
        assert published == (fix["reason"] is None) == (fix["covariance_enu"] is not None)
    assert any(fix["status"] == "fix" for fix in fixes)


def test_batches_without_a_fix_are_printed_with_the_reason(files):
    """Readings with a noise of 120 mGal, as large as the map varies."""
    told = ("--sensor-sigma", "120mGal", "--map-sigma", 0, "--bias-sigma", 0)
    printed = answer(*words_for(files, "disturbance"), *told, "--prior-sigma", 200)
    assert printed.count("no fix: ") >= 2
    assert "0 fixes of 2 batches\n" in printed
    assert "--reference" in printed


def test_chained_batches_and_report(files, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "png", lambda _: b"not drawn")
    chained = ("--batch-length", 20, "--chain", "--velocity-sigma", 0.01, "--walk-sigma", 50)
    out = tmp_path / "fixes.json"
    outs = ("--out", out, "--report", tmp_path / "report")
    printed = answer(*words_for(files, "disturbance"), *chained, *outs)
    assert all("aided_latitude" in fix for fix in json.loads(out.read_text()))
    assert (tmp_path / "report" / "report.html").is_file()
    assert "3 fixes of 3 batches" in printed
    assert "learnt (median of batches): map error" in printed


BAD = {
    "no track": (["--track", "none.csv"], "none.csv: no such file or folder"),
    "no map": (["--map", "none.nc"], "none.nc: no such file or folder"),
    "suffix": (["--out", "x.txt"], "x.txt: must end in .json or .csv or .geojson"),
    "folder": (["--out", "/dev/null/x.json"], "/dev/null/x.json: cannot be written"),
    "key": (
        ["--set", "matcher.stirde=3"],
        "unknown key 'matcher.stirde', did you mean 'matcher.stride'?",
    ),
    "section": (["--set", "route.speed=3"], "only keys that begin with matcher. count here"),
    "option": (["--set", "matcher.options.sample=3"], "of pmht: unknown key 'sample'"),
    "length": (["--batch-length", "x"], "matcher.batch_length"),
    "short": (["--batch-length", "2"], "(--batch-length): must be at least 3"),
    "no bag": (["--fix-topic", "x"], "--fix-topic: goes with a bag, which"),
    "prior": (["--prior-sigma", "0"], "'--prior-sigma'"),
    "velocity": (["--velocity-sigma", "-1"], "'--velocity-sigma'"),
    "walk": (["--chain", "--walk-sigma", "1e9"], "'--walk-sigma'"),
    "sensor of another unit": (["--sensor-sigma", "0.5"], "did you mean 0.5mGal?"),
    "unit of the map's error": (["--map-sigma", "3nT"], "'nT' does not fit a disturbance map"),
    "sensor": (["--sensor-sigma", "0"], "--sensor-sigma: must be > 0"),
    "map sigma": (["--map-sigma", "much"], "must be a number, or one with its unit, not 'much'"),
    "bias": (["--bias-sigma", "-1"], "--bias-sigma: must be >= 0"),
    "unknown unit": (["--track-unit", "stone"], "--track-unit: unknown unit 'stone'"),
    "wrong unit": (["--track-unit", "mGal"], "they look like m/s²: give --track-unit 'm/s²'"),
    "reduction": (["--reduction", "speed"], "(--reduction) must be one of none, latitude, v"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_ends_in_one_line(files, tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    options, message = BAD[case]
    map_file, track, *_ = files["disturbance"]
    words = ("match", "--map", map_file, "--track", track, "--map-sigma", "1e-6")
    assert message in refusal(*words, *options)
    assert not list(tmp_path.iterdir())
