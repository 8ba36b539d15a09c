import json
import math
from dataclasses import replace

import numpy as np
import pytest

from helpers.studies import outcomes
from isogal.evaluation.results import canonical_json, write_json
from isogal.evaluation.summary import diverged, summarise
from isogal.scenario import Scenario

CONTRACT = {
    "scenario": None,
    "matcher": None,
    "runs": None,
    "diverged": None,
    "position_error": {"mean", "rms", "mean_after_1h", "rms_after_1h"},
    "unaided": {"mean", "rms"},
    "bound": {"rms", "rms_after_1h"},
    "nees_per_axis": {"mean", "interval"},
    "nees_all_scans": {"mean", "interval"},
    "judgement": {"share", "runs"},
    "integrity": {"risk", "run_hours", "correlation_time", "level", "exceedances", "alert_limit"},
    "fixes": {"published", "declined", "failed", "rejected"},
    "time": {"wall_s", "fix_ms_median"},
    "rms_over_time": {"time", "aided", "unaided", "bound"},
}


def test_the_format_is_the_contracts(make_runs):
    runs = make_runs()
    result = summarise(runs, Scenario(), np.full(121, 40.0), wall_seconds=2.0)
    assert list(result) == list(CONTRACT)
    for key, inside in CONTRACT.items():
        if inside is not None:
            assert set(result[key]) == inside
    assert result["matcher"] == "pmht" and result["runs"] == 3
    assert json.loads(canonical_json(result)) == result


def test_figures_by_hand(make_runs):
    states = 121
    error = np.zeros((2, states, 2))
    error[0, :, 0], error[1, :, 1] = 30.0, -50.0
    late = np.arange(states) * 60.0 > 3600.0
    error[1, late, 1] = 10.0
    runs = make_runs(runs=2, error=error, unaided_error=np.full((2, states, 2), [300.0, 400.0]))
    result = summarise(runs, Scenario(), np.where(late, 6.0, 8.0), wall_seconds=1.5)
    assert result["position_error"]["mean_after_1h"] == pytest.approx(20.0)
    assert result["position_error"]["rms_after_1h"] == pytest.approx(math.sqrt((900 + 100) / 2))
    assert result["position_error"]["mean"] == pytest.approx((30 * 121 + 50 * 61 + 10 * 60) / 242)
    assert result["unaided"] == {"mean": pytest.approx(500.0), "rms": pytest.approx(500.0)}
    assert result["bound"]["rms_after_1h"] == pytest.approx(6.0)
    assert result["bound"]["rms"] == pytest.approx(math.sqrt((64 * 61 + 36 * 60) / 121))
    assert result["time"]["wall_s"] == 1.5
    assert result["time"]["fix_ms_median"] == pytest.approx(1e3 * np.median(runs.fix_seconds))
    assert result["rms_over_time"]["aided"][0] == pytest.approx(math.sqrt((900 + 2500) / 2))
    assert len(result["rms_over_time"]["time"]) == 121


def test_one_hertz_states_are_thinned_to_a_minute(make_runs):
    runs = make_runs(runs=1, states=601, step=1.0, batches=2)
    over_time = summarise(runs, Scenario(), np.ones(601))["rms_over_time"]
    assert over_time["time"] == [60.0 * k for k in range(11)]
    np.testing.assert_allclose(over_time["aided"], runs.horizontal_error[0, ::60])


def test_diverged_runs_are_counted_by_their_last_half_hour(make_runs):
    runs = make_runs(runs=4)
    error = runs.error.copy()
    error[1, -31:] = [1900.0, 1000.0]  # 2147 m over the last 30 min
    error[2, :-31] = 5000.0  # far off, but recovered before the last 30 min
    error[3, -5:] = np.nan
    runs = replace(runs, error=error)
    np.testing.assert_array_equal(diverged(runs), [False, True, False, True])
    assert summarise(runs, Scenario(), np.ones(121))["diverged"] == 2


def test_nees_is_that_of_the_navigator_after_published_fixes(make_runs):
    runs = make_runs(runs=200)
    result = summarise(runs, Scenario(), np.ones(121))["nees_per_axis"]
    assert result["interval"][0] < result["mean"] < result["interval"][1]
    error = runs.posterior_error.copy()
    error[:, 5] = 1e6
    spoilt = replace(runs, posterior_error=error)
    assert summarise(spoilt, Scenario(), np.ones(121))["nees_per_axis"]["mean"] > 1e3
    declined = replace(spoilt, **outcomes([["flat" if k == 5 else "" for k in range(24)]] * 200))
    kept = summarise(declined, Scenario(), np.ones(121))
    assert kept["nees_per_axis"]["mean"] < 1.1
    fixes = {"published": 200 * 23, "declined": 200, "failed": 0, "rejected": 0}
    assert kept["fixes"] == fixes


def test_figures_that_do_not_exist_are_null(make_runs):
    runs = make_runs(runs=1, states=10, batches=0)
    result = summarise(runs, Scenario(), np.full(10, np.nan))
    assert result["position_error"]["mean_after_1h"] is None
    assert result["bound"]["rms"] is None
    assert result["nees_per_axis"] == {"mean": None, "interval": [None, None]}
    assert result["judgement"]["share"]["good"] == 0.0  # a run without fixes is no success
    assert result["time"] == {"wall_s": None, "fix_ms_median": None}
    assert "NaN" not in canonical_json(result)


def test_json_is_canonical(tmp_path):
    value = {
        "b": [1, 2.5, math.inf],
        "a": {"x": np.float64(0.1), "y": ()},
        "c": [{"n": np.int64(3)}],
        "é": None,
        "e": {},
    }
    text = canonical_json(value)
    assert text == (
        '{\n  "b": [1, 2.5, null],\n  "a": {\n    "x": 0.1,\n    "y": []\n  },\n'
        '  "c": [\n    {\n      "n": 3\n    }\n  ],\n  "é": null,\n  "e": {}\n}\n'
    )
    write_json(tmp_path / "out" / "results.json", value)
    assert (tmp_path / "out" / "results.json").read_text(encoding="utf-8") == text


def test_smoothed_states_have_a_section_of_their_own(make_runs):
    states = 121
    runs = make_runs(runs=2, error=np.full((2, states, 2), [60.0, 80.0]))
    error, covariance = np.full((2, states, 2), [6.0, 8.0]), np.zeros((2, states, 2, 2))
    covariance[:] = np.diag([36.0, 32.0])
    smoothed = replace(runs, smoothed_error=error, smoothed_covariance=covariance)
    bound = np.full(states, 40.0)
    result = summarise(smoothed, Scenario(), bound, smoothed_bound_rms=np.full(states, 8.0))
    assert list(result) == [*CONTRACT, "smoothed"]
    found = result["smoothed"]
    assert found["position_error"]["rms_after_1h"] == pytest.approx(10.0)
    assert found["bound"] == {"rms": pytest.approx(8.0), "rms_after_1h": pytest.approx(8.0)}
    assert found["ratio"] == pytest.approx(1.25) and found["of_causal"] == pytest.approx(0.1)
    assert found["nees_per_axis"]["mean"] == pytest.approx(1.5)
    assert set(found["rms_over_time"]) == {"time", "smoothed", "bound"}
    unknown = summarise(smoothed, Scenario(), bound)["smoothed"]
    assert unknown["ratio"] is None and unknown["bound"]["rms"] is None
