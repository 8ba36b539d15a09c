"""Runs or studies side by side."""

import json

import pytest

from helpers.command_line import answer, refusal


def write(folder, error, **scenario):
    folder.mkdir()
    time = [0.0, 60.0, 120.0]
    document = {
        "scenario": {"seed": 0, "route": {"speed": 22.0}, "truth": {}, **scenario},
        "runs": 8,
        "position_error": {"mean": error, "rms": 78.4},
        "rms_over_time": {"time": time, "aided": [9.0, 8.0, 7.0], "unaided": [9.0, 20.0, 50.0]},
    }
    (folder / "results.json").write_text(json.dumps(document), encoding="utf-8")


@pytest.fixture
def studies(tmp_path):
    write(tmp_path / "one", 64.75, seed=3)
    write(tmp_path / "two", None, matcher={"name": "tercom"})
    return [tmp_path / "one", tmp_path / "two"]


def test_what_differs_and_the_figures_of_merit(studies, tmp_path):
    found = json.loads(answer("compare", *studies, "--json"))
    assert found["runs"] == ["one", "two"]
    assert found["settings"] == {"seed": [3, 0], "matcher.name": [None, "tercom"]}
    assert found["merits"]["mean position error (m)"] == [64.75, None]
    text = answer("compare", *studies, "--out", tmp_path / "both")
    assert "64.8" in text
    assert (tmp_path / "both" / "rms_over_time.png").stat().st_size > 5_000
    assert "What differs in the scenarios" in (tmp_path / "both" / "report.html").read_text()


def test_names_tell_runs_of_the_same_folder_name_apart(tmp_path):
    for parent in ("a", "b"):
        (tmp_path / parent).mkdir()
        write(tmp_path / parent / "run", 1.0)
    found = json.loads(answer("compare", tmp_path / "a/run", tmp_path / "b/run", "--json"))
    assert found["runs"] == ["a/run", "b/run"]
    assert found["settings"] == {}


def test_what_cannot_be_compared(studies, tmp_path):
    assert "two or more" in refusal("compare", studies[0], studies[0] / "results.json")
    words = "compare", *studies, "--out", studies[0]
    assert "is one of those compared, whose report would be lost" in refusal(*words)
    assert "no results.json" in refusal("compare", studies[0], tmp_path)
    other = tmp_path / "other.json"
    for text, said in (("{", "not JSON"), ("[]", "a JSON object"), ("{}", "not the results")):
        other.write_text(text)
        line = refusal("compare", studies[0], other)
        assert str(other) in line and said in line
