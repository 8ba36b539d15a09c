"""Runs judged by what their user loses."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.studies import outcomes
from isogal.evaluation.judgement import KINDS, judge
from isogal.evaluation.summary import diverged, summarise
from isogal.scenario import Scenario

SCALE = 50.0
"""m, 1-sigma of either axis that the made-up runs claim."""


@pytest.fixture
def calm(make_runs):
    """Four runs with errors of 10 m, unaided ones of 300 m."""
    runs = make_runs(runs=4, scale=SCALE)
    return replace(
        runs, error=np.full((4, 121, 2), 10.0), unaided_error=np.full((4, 121, 2), 300.0)
    )


def flags(runs):
    judgement = judge(runs, diverged(runs))
    return {kind: np.flatnonzero(judgement[kind]).tolist() for kind in (*KINDS, "good")}


def test_a_run_without_any_fix_is_not_good_and_not_called_worse(calm):
    none = outcomes([["flat" if run == 2 else ""] * 24 for run in range(4)])
    runs = replace(calm, **none, unaided_error=calm.error - 1.0)
    found = flags(runs)
    assert (found["unaided"], found["worse_than_unaided"], found["good"]) == ([2], [0, 1, 3], [])


def test_worse_than_unaided_is_after_the_first_hour(calm):
    error = calm.error.copy()
    error[0, :61] = 240.0  # within the first hour
    error[1, 61:] = 301.0
    error[2, 61] = np.nan
    result = flags(replace(calm, error=error, covariance=calm.covariance * 100.0))
    assert result["worse_than_unaided"] == [1, 2]
    short = {name: getattr(calm, name)[:31] for name in ("time", "latitude", "longitude")}
    short |= {
        name: getattr(calm, name)[:, :31] for name in ("error", "covariance", "unaided_error")
    }
    short["error"] = short["error"] * [[[1.0]], [[40.0]], [[1.0]], [[1.0]]]
    assert flags(replace(calm, **short))["worse_than_unaided"] == [1]


@pytest.mark.parametrize(
    ("sigmas", "states", "found"),
    [(4.9, 121, []), (5.1, 10, []), (5.1, 11, [1])],
    ids=["within", "9 min", "10 min"],
)
def test_beyond_claimed_sigmas_for_ten_minutes(calm, sigmas, states, found):
    error = calm.error.copy()
    error[1, :states] = [sigmas * SCALE, 0.0]
    runs = replace(calm, error=error, unaided_error=calm.unaided_error * 100.0)
    assert flags(runs)["overconfident"] == found


def test_nees_at_all_scans_sees_what_no_fix_shows(make_runs):
    runs = make_runs(runs=100)
    result = summarise(runs, Scenario(), np.ones(121))
    assert result["nees_all_scans"]["mean"] == pytest.approx(1.0, abs=0.03)
    error = runs.error.copy()
    error[:, 60:] *= 3.0
    result = summarise(replace(runs, error=error), Scenario(), np.ones(121))
    assert result["nees_all_scans"]["mean"] == pytest.approx((59 + 61 * 9) / 120, rel=0.03)
    low, high = result["nees_all_scans"]["interval"]
    assert low < 1.0 < high < 1.2
