"""What the matcher's node says of batches in a row."""

import numpy as np
import pytest

from isogal.matching.interfaces import SATELLITES, Fix
from isogal_ros.nodes.health import ERROR, OK, WARN
from pmht_mm_node.verdict import AGREED, FEW, MANY, Verdict, line

GOOD = Fix(10.0, 0.1, 0.2, np.diag([9.0, 16.0]))
FLAT = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), "too few features")
KEPT = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), SATELLITES)
FAILED = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), "LinAlgError: Singular", failed=True)
MISFIT = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), "no track fits", diagnostics={
    "unexplained": 1.0,
})  # fmt: skip
LOST = Fix(10.0, 0.1, 0.2, np.full((2, 2), np.nan), "the place is searched for", reset=True)
SEARCH = Fix(10.0, 0.1, 0.2, np.eye(2), diagnostics={"diverged": 0.6})
DOUBT = Fix(10.0, 0.1, 0.2, np.eye(2), diagnostics={"late": 0.96})
PERHAPS = Fix(10.0, 0.1, 0.2, np.eye(2), diagnostics={"late": 0.9, "diverged": 0.4})


@pytest.mark.parametrize(("fixes", "levels"), [
    ([GOOD, FLAT, GOOD], [OK, OK, OK]),
    ([FLAT] * MANY, [OK] * (FEW - 1) + [WARN] * (MANY - FEW) + [ERROR]),
    ([KEPT] * MANY, [OK] * MANY),
    ([FAILED] * FEW + [GOOD], [WARN] * (FEW - 1) + [ERROR, OK]),
    ([MISFIT] * FEW + [GOOD], [WARN] * (FEW - 1) + [ERROR, OK]),
    ([LOST, FLAT, *[GOOD] * (AGREED + 1)], [ERROR, ERROR, *[WARN] * AGREED, OK]),
    ([LOST, *[GOOD] * AGREED, MISFIT, *[GOOD] * AGREED], [ERROR, *[WARN] * (2 * AGREED), OK]),
    ([SEARCH, GOOD], [WARN, OK]),
    ([DOUBT, GOOD], [WARN, OK]),
    ([PERHAPS], [OK]),
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
    assert "readings are late" in verdict.text


def test_lines() -> None:
    assert line(10**10, GOOD) == "10 s: fix with a 1-sigma of 5 m"
    assert line(10**10, FLAT) == "10 s: no fix: too few features"
