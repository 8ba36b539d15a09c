"""A matcher that is started again goes on in the batch, with what it had learnt."""

import numpy as np
import pytest
from std_srvs.srv import Trigger

from helpers.node_bench import Bench, bench, stamps
from isogal.matching.interfaces import SATELLITES, Fix
from isogal_ros import topics
from isogal_ros.nodes.health import ERROR, OK, WARN
from pmht_mm_node.verdict import AGREED, FEW, MANY, Verdict, line


@pytest.fixture(scope="module")
def drive(flight):
    noise = np.random.default_rng(3).normal(0.0, 1e-5, 100)

    def go(made: Bench, first: int, last: int) -> None:
        """Scans of a navigator that is 30 m off."""
        for taken, scan in enumerate(range(first, last + 1), 1):
            flight(made, scan, north=5e-6, noise=noise[scan])
            # states 10 s apart: with the next one a covariance that is still to come is given up
            made.wait(lambda n=taken: made.node.taken >= n and not made.node.scans.waiting)

    return go


def fixes(made: Bench) -> dict[int, tuple[float, float]]:
    return {
        stamp: (fix.latitude, fix.longitude)
        for stamp, fix in zip(stamps(made, topics.FIX), made.heard["pmht_mm/fix"], strict=True)
    }


def test_killed_between_two_scans_it_gives_the_same_fixes(scenario, drive, tmp_path) -> None:
    one = scenario("matcher.name=pmht")
    with bench(topics.PMHT_MM, one) as made:
        drive(made, 1, 24)
        undisturbed = fixes(made)
    assert list(undisturbed) == [60, 120, 180, 240]
    own = {"checkpoint": str(tmp_path)}
    found = {}
    for first, last in ((1, 3), (4, 14), (15, 18), (19, 24)):
        with bench(topics.PMHT_MM, one, **own) as made:
            drive(made, first, last)
            found |= fixes(made)
    assert found == undisturbed


@pytest.mark.parametrize(
    ("first", "missing", "ends"), [(11, 2, [120, 180, 240]), (15, 6, [180, 240])]
)
def test_an_outage_costs_its_scans_and_batches_end_when_they_would_have(
    scenario, drive, tmp_path, first, missing, ends
) -> None:
    """One that is longer than the batch's silence is told."""
    own = {"checkpoint": str(tmp_path)}
    with bench(topics.PMHT_MM, scenario(), **own) as made:
        drive(made, 1, 8)
    with bench(topics.PMHT_MM, scenario(), **own) as made:
        drive(made, first, 24)
        assert list(fixes(made))[-len(ends) :] == ends
        assert made.says()[-1][2]["scans missing"] == str(missing)
        told = any(f"{missing} scans missing before" in text for _, text, _ in made.says())
        assert told == (missing == 6)
        assert made.says()[-1][0] == OK


def test_without_a_checkpoint_it_begins_and_says_so(scenario, drive) -> None:
    with bench(topics.PMHT_MM, scenario()) as made:
        drive(made, 9, 24)
        assert list(fixes(made)) == [120, 180, 240]
        assert "the first batch is not whole: it has 4 scans" in made.batches()[0][0]
        assert made.heard["pmht_mm/fix"][0].status.status == -1


def test_after_a_reset_nothing_is_left_and_time_may_begin_anew(scenario, drive, tmp_path) -> None:
    """Of a recording that was played again each reading was older than the last."""
    with bench(topics.PMHT_MM, scenario(), checkpoint=str(tmp_path)) as made:
        drive(made, 1, 14)
        assert list(tmp_path.iterdir())
        assert made.call("reset", Trigger.Request()).success
        assert not list(tmp_path.iterdir())
        made.heard.clear()
        drive(made, 1, 12)
        assert list(fixes(made)) == [60, 120]
        assert made.node.health.dropped == {}


def test_no_batch_ends_in_a_time_of_which_the_navigator_said_nothing(scenario, drive) -> None:
    """It once gave a fix there with the navigator's covariance after it; the next batch has the
    readings before."""
    with bench(topics.PMHT_MM, scenario("matcher.name=pmht", "matcher.stride=3")) as made:
        drive(made, 1, 10)  # due at 60 s, 90 s, 120 s, ...
        drive(made, 14, 18)
        assert list(fixes(made)) == [60, 90, 120, 150, 180]
        reasons = {float(figures["stamp"]): words for words, figures in made.batches()}
        assert reasons[120.0] == "the navigator said nothing of the batch's end"
        assert reasons[150.0] == "fix published"


def test_silence_of_the_instrument_is_told_by_the_time_of_the_stamps(scenario, drive) -> None:
    """By the wall clock three minutes of a fast simulation passed between two looks."""
    with bench(topics.PMHT_MM, scenario()) as made:
        drive(made, 1, 3)
        for k in (40, 50, 60, 70, 80):
            made.nav(k, -0.64, 2.56)
        assert made.told("no readings for 50 s")
        assert not any("no readings for 40 s" in text for _, text, _ in made.says())


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


def test_what_is_said() -> None:
    verdict = Verdict()
    verdict.take(DOUBT)
    assert "readings are late" in verdict.text
    assert line(10**10, GOOD) == "10 s: fix with a 1-sigma of 5 m"
    assert line(10**10, FLAT) == "10 s: no fix: too few features"
