"""The rows of `benchmarks/mismatch.py`: what is told and what is true; it goes on where it was."""

import importlib
import re

import closed_loop
import mismatch
import numpy as np
import pytest
from mismatch_maps import Maps
from mismatch_rows import MGAL_3, ROWS

from helpers.batches import ORIGIN
from helpers.packages import ROOT
from isogal.scenario import Scenario, load_scenario

MAPS = Maps("fine.nc", "coarse.nc", "rated.nc", "magnetic.nc", 7e-5, 700.0)


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_told_and_untold_are_one_world_and_who_is_told_nothing_has_its_defaults(row):
    untold, told, nothing = (
        mismatch.scenario_of(row, kind, MGAL_3, MAPS)
        for kind in ("untold", "told", "nothing told")
    )
    assert untold.matcher.stride == told.matcher.stride == 5
    assert bool(untold.truth) or not row.untold or row.world[0].startswith("map_error.")
    worlds = [
        it.true.model_dump(exclude={"matcher"} | ({"gravity"} if "left" in row.name else set()))
        for it in (untold, told)
    ]
    assert worlds[0] == worlds[1]
    if row.tellable and row.untold:
        assert told != untold
        assert told.truth == {} or row.told

    assert nothing.matcher == Scenario().matcher.model_copy(update={"stride": 5})
    worlds = [it.true.model_dump(exclude={"matcher"}) for it in (untold, nothing)]
    assert worlds[0] == worlds[1]
    if row.world == ("gravity.field=map",):
        assert nothing.gravity == Scenario().gravity
    assert nothing.velocity == type(nothing.velocity)(kind=nothing.velocity.kind)
    assert nothing.height == type(nothing.height)(source=nothing.height.source)


@pytest.mark.parametrize(
    "script",
    [
        *("alignment", "black_box", "deception", "felt_gravity", "integrity", "mismatch"),
        *("navigability", "several_fields", "smoothing", "voyage"),
    ],
)
def test_the_page_that_a_script_names_has_its_marks(script):
    module = importlib.import_module(script)
    (name,) = re.findall(r"--page (docs/evidence/\S+\.md)", module.__doc__)
    text = (ROOT / name).read_text(encoding="utf-8")
    assert 0 <= text.find(module.MARKS[0]) < text.find(module.MARKS[1])
    assert f"benchmarks/{script}.py" in text and f"--page {name}" in text


def test_parts_are_computed_once_and_make_a_line(tmp_path, monkeypatch):
    place = f"route.start={np.degrees(ORIGIN).tolist()}", "route.end=[-36.4, 147.2]"
    scenario = load_scenario(None, [*place, "route.duration=300"])
    parts = list(closed_loop.parts_of(scenario, 23, tmp_path))
    assert [runs for runs, _ in parts] == [range(10), range(10, 20), range(20, 23)]
    first = closed_loop.some_runs(scenario, range(2), parts[0][1])
    monkeypatch.setattr(closed_loop, "simulate", lambda *_: pytest.fail("computed again"))
    again = closed_loop.some_runs(scenario, range(2), parts[0][1])
    np.testing.assert_array_equal(first.error, again.error)
    other = scenario.model_copy(update={"truth": {"gravimeter": {"sigma": "3x"}}})
    assert {path for _, path in closed_loop.parts_of(other, 8, tmp_path)}.isdisjoint(
        path for _, path in parts
    )
    figures = closed_loop.figures_of(scenario, again, np.full(again.time.shape, 10.0), 60.0)
    assert figures["ratio"] == pytest.approx(0.1 * figures["rms"])
    cells = closed_loop.cells_of(figures, mismatch.COLUMNS)
    assert cells[0] == "2" and cells[2] == "10.0" and cells[-1].endswith(" %")
    assert figures["unaided"] > 10.0  # m: not the share of runs that are judged so
