"""No command learns after its work that the result has no place: every option that names a file or
folder to be written is checked before anything is read."""

from pathlib import Path

import pytest

from helpers.command_line import call
from isogal.cli.montecarlo import _say_what_is_replaced
from isogal.evaluation.results import write_json
from isogal.scenario import Scenario

ALMOST = {
    "match": ("--map", "no.nc", "--track", "no.csv"),
    "plan": ("--map", "no.nc", "--from", "0,0", "--to", "1,1"),
    "map grid": ("no.csv",),
    "map continue": ("no.nc", "--height", "9"),
    "map convert": ("no.nc",),
    "montecarlo": ("--runs", "1"),
    "mag calibrate": ("no.csv",),
    "mag compensate": ("no.csv",),
    "compare": ("a", "b"),
    "view": ("no",),
    "replay": ("no",),
}
"""Arguments that come before, of files that are not there either."""
FILES = {
    "match": ("--out", "x.json"),
    "plan": ("--out", "x.yaml"),
    "plan --path": ("--path", "x.yaml"),
    "map grid": ("x.nc",),
    "map continue": ("x.nc",),
    "map convert": ("x.nc",),
    "map synth": ("--out", "x.nc"),
    "map info --figure": ("no.nc", "--figure", "x.png"),
    "map navigability": ("no.nc", "--out", "x.nc"),
    "map variability": ("no.nc", "--figure", "x.png"),
    "mag calibrate": ("--out", "x.yaml"),
    "mag compensate": ("--out", "x.csv"),
    "mag compensate --learnt": ("--out", "y.csv", "--learnt", "x.yaml"),
    "view": ("--out", "x.html"),
}
FOLDERS = {
    "match --report": ("--report", "x"),
    "montecarlo": ("--out", "x"),
    "paper": ("--out", "x"),
    "run": ("--out", "x"),
    "run --bag": ("--bag", "x"),
    "replay": ("--out", "x"),
    "faults": ("--out", "x"),
    "compare": ("--out", "x"),
    "map fetch": ("--base-url", "http://127.0.0.1:9", "--out", "x"),
    "mag calibrate --report": ("--out", "y.yaml", "--report", "x"),
}
CASES = [
    *((name, words, "is a folder, where a file is needed") for name, words in FILES.items()),
    *((name, words, "is a file, where a folder is needed") for name, words in FOLDERS.items()),
]


@pytest.mark.parametrize(("name", "words", "why"), CASES, ids=[name for name, *_ in CASES])
def test_an_output_that_cannot_be_written_is_refused_first(
    tmp_path, monkeypatch, name, words, why
):
    monkeypatch.chdir(tmp_path)
    taken = next(word for word in words if word.partition(".")[0] == "x")
    Path(taken).mkdir() if "file is needed" in why else Path(taken).write_text("kept")
    command = name.partition(" --")[0]
    status, out, err = call(*command.split(), *ALMOST.get(command, ()), *words)
    assert (status, out, err) == (2, "", f"isogal: {taken}: {why}\n")
    assert [path.name for path in tmp_path.iterdir()] == [taken]


@pytest.mark.parametrize(
    "words",
    [
        "map convert x.nc LINK.nc",
        "map grid x.nc ./x.nc",
        "map continue x.nc x.nc --height 9",
        "match --map no.nc --track x.csv --out x.csv",
        "match --map no.nc --track no.csv --also map=x.csv,column=a --out x.csv",
        "mag compensate x.csv --out x.csv --online",
        "plan --map no.nc --from 0,0 --to 1,1 --scenario x.yaml --out x.yaml",
    ],
)
def test_what_is_read_is_not_written_over(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    for name in ("x.nc", "x.csv", "x.yaml"):
        Path(name).write_text("kept")
    Path("LINK.nc").symlink_to("x.nc")
    status, out, err = call(*words.split())
    assert (status, out) == (2, "")
    assert "is read by this command; give what is written another name\n" in err
    assert err.count("\n") == 1
    assert {path.read_text() for path in tmp_path.iterdir()} == {"kept"}


def test_results_of_another_scenario_are_not_replaced_in_silence(tmp_path, capsys):
    path, settings = tmp_path / "results.json", Scenario()
    _say_what_is_replaced(path, settings)
    write_json(path, {"scenario": settings.model_dump(mode="json")})
    _say_what_is_replaced(path, settings)
    assert not capsys.readouterr().err
    _say_what_is_replaced(path, Scenario(seed=1))
    assert "results.json: is of another scenario" in capsys.readouterr().err
