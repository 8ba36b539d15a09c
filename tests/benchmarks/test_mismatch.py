"""The rows of `benchmarks/mismatch.py`: what is told and what is true; it goes on where it was."""

import importlib
import re

import mismatch
import pytest
from mismatch_maps import Maps
from mismatch_rows import MGAL_3, ROWS

from helpers.packages import ROOT
from isogal.scenario import Scenario

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
