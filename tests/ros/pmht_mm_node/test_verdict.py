"""What the matcher's node says of batches in a row."""

import numpy as np
import pytest

from isogal.matching.interfaces import Fix
from isogal_ros.nodes.health import ERROR, OK, WARN
from pmht_mm_node.verdict import AGREED, FEW, MANY, Verdict, line

GOOD = Fix(10.0, 0.1, 0.2, np.diag([9.0, 16.0]))
FLAT = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), "too few features")
FAILED = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), "the matcher failed: LinAlgError: Singular")
MISFIT = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), "readings and map do not agree")
LOST = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), "do not agree; navigator lost", reset=True)
SEARCH = Fix(10.0, 0.1, 0.2, np.eye(2), diagnostics={"search_readings": 2.0})
DOUBT = Fix(10.0, 0.1, 0.2, np.eye(2), diagnostics={
    "as_assumed": 0.01, "navigator_sigma_factor": 1.0, "fix_sigma_factor": 1.0, "delay": 19.6,
})  # fmt: skip


@pytest.mark.parametrize(("fixes", "levels"), [
    ([GOOD, FLAT, GOOD], [OK, OK, OK]),
    ([FLAT] * MANY, [OK] * (FEW - 1) + [WARN] * (MANY - FEW) + [ERROR]),
    ([FAILED] * FEW + [GOOD], [WARN] * (FEW - 1) + [ERROR, OK]),
    ([MISFIT] * FEW + [GOOD], [WARN] * (FEW - 1) + [ERROR, OK]),
    ([LOST, FLAT, *[GOOD] * (AGREED + 1)], [ERROR, ERROR, *[WARN] * AGREED, OK]),
    ([LOST, *[GOOD] * AGREED, MISFIT, *[GOOD] * AGREED], [ERROR, *[WARN] * (2 * AGREED), OK]),
    ([SEARCH, GOOD], [WARN, OK]),
    ([DOUBT, GOOD], [WARN, OK]),
])  # fmt: skip
def test_levels(fixes, levels) -> None:
    verdict, got = Verdict(), []
    for fix in fixes:
        verdict.take(fix)
        got.append(verdict.level)
    assert got == levels


def test_what_was_told_is_in_doubt() -> None:
    verdict = Verdict()
    verdict.take(DOUBT)
    assert "20 s late" in verdict.text


def test_lines() -> None:
    assert line(10**10, GOOD) == "10 s: fix with a 1-sigma of 5 m"
    assert line(10**10, FLAT) == "10 s: no fix: too few features"
