"""`isogal view` of a study."""

import pytest

pytest.importorskip("bokeh", reason="needs bokeh, which draws the page")

from helpers.command_line import answer, refusal
from helpers.studies import small_scenario, wavy_map
from isogal.evaluation.results import write_json
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.montecarlo.cases import Case, Job
from isogal.montecarlo.store import Store


@pytest.fixture(scope="module")
def study(tmp_path_factory, make_runs):
    """What a study of three runs leaves behind."""
    folder = tmp_path_factory.mktemp("study")
    write_netcdf(wavy_map(), folder / "map.nc")
    scenario = small_scenario(map={"source": str(folder / "map.nc")})
    store, runs = Store(folder / "out" / "runs"), make_runs(runs=3, detail=True)
    case = Case("montecarlo", scenario, 3, wavy_map())
    for run in range(3):
        store.put(Job(case, run), runs.part([run]))
    document = {"scenario": scenario.model_dump(mode="json"), "runs": 3}
    write_json(folder / "out" / "results.json", document)
    return folder / "out"


def test_a_run_of_a_study(study, tmp_path, make_runs):
    page = tmp_path / "view.html"
    assert str(page) in answer("view", study, "--run", 2, "--out", page)
    text = page.read_text(encoding="utf-8")
    assert "out: run 2 of 3" in text
    assert f'"north":[{make_runs(runs=3).error[2, 0, 0]:.9g}' in text


def test_what_cannot_be_shown(study, tmp_path):
    assert "runs 0 to 2" in refusal("view", study, "--run", 3)
    assert "no such recording" in refusal("view", tmp_path / "missing")
    assert "neither a recording" in refusal("view", tmp_path)
    write_json(tmp_path / "results.json", {"scenario": {"seed": 1}, "runs": 3})
    assert "holds no runs" in refusal("view", tmp_path)
