"""`make accept`: a row is measured, and set beside the one that was kept."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import acceptance
import acceptance_rows
import numpy as np
import pytest
from acceptance_figures import compared, jackknife, rms
from acceptance_rows import Place, Row, all_rows
from acceptance_table import print_table

from helpers.batches import ORIGIN
from isogal.matching import map_matching
from isogal.scenario import load_scenario

KEPT = {
    "seed": 1,
    "rms": 10.0,
    "rms_of_run": [9.0, 10.0, 11.0, 10.0, 9.5],
    "nees_of_run": [0.9, 1.0, 1.1, 1.0, 0.9],
}


def tiny(place):
    ends = f"route.start={np.degrees(ORIGIN).tolist()}", "route.end=[-36.4, 147.2]"
    return load_scenario(None, [*ends, "route.duration=900", "gravity.field=normal"])


def test_a_row_has_all_figures_and_cells(monkeypatch, tmp_path, capsys):
    clock, place = map_matching.clock, Place(tmp_path, tmp_path / "made", 7)
    row = Row("tiny", make=tiny, needs=(), settled=300.0, minutes=(10,))
    monkeypatch.setattr(acceptance, "all_rows", lambda: [row])
    with ThreadPoolExecutor(1) as pool:
        row = acceptance.measure(row, place, 2, pool)
    assert map_matching.clock is clock
    assert (row["runs"], row["seed"], row["failed_fixes"]) == (2, 7, 0)
    assert len(row["nees_of_run"]) == 2
    assert row["rms"] == pytest.approx(rms(np.array(row["rms_of_run"])), rel=1e-3)
    assert 0.0 < row["fix_ms"]["median"] <= row["fix_ms"]["p99"] <= row["fix_ms"]["max"]
    assert min(row["run_hours_per_cpu_s"], row["memory_mb"]) > 0.0
    print_table({"tiny": row, "other": {"skipped": "no file"}}, {"tiny": row})
    assert "1.000±0.000" in capsys.readouterr().out


def changed(**more):
    return KEPT | more


def test_pairs_of_runs_show_a_small_loss():
    def times(factor):
        return changed(rms_of_run=[factor * x for x in KEPT["rms_of_run"]])

    assert compared(times(1.02), KEPT).worse == ()
    worse = compared(times(1.04), KEPT)
    assert worse.ratio == pytest.approx(1.04)
    assert worse.ratio_error == pytest.approx(0.0, abs=1e-9)
    assert worse.worse == ("RMS",)
    assert compared(changed(rms_of_run=times(1.04)["rms_of_run"][:2]), KEPT).worse == ("RMS",)
    other_seed = compared(times(1.04) | {"seed": 2}, KEPT)
    assert other_seed.ratio_error > 0.04
    assert other_seed.worse == ()
    noisy = compared(changed(rms_of_run=[9.0, 10.0, 13.0, 10.0, 9.5]), KEPT)
    assert noisy.ratio > 1.04 and noisy.worse == ()


@pytest.mark.parametrize(
    ("new", "old", "worse"),
    [
        ({"nees_of_run": [1.2, 1.2, 1.25, 1.2, 1.2]}, {}, ("NEES",)),
        ({"nees_of_run": [0.7, 0.8, 0.85, 0.8, 0.7]}, {}, ("NEES",)),
        ({"nees_of_run": [1.0, 1.05, None, 1.0, 1.0]}, {}, ()),
        ({"found": {"60": 0.5, "75": 0.9}}, {"found": {"60": 0.9, "75": 1.0}}, ("found",)),
        ({"found": {"60": 0.5, "75": 1.0}}, {"found": {"60": 0.9, "75": 1.0}}, ()),
    ],
)
def test_nees_and_starts_found_count_too(new, old, worse):
    assert compared(changed(**new), changed(**old)).worse == worse


def test_the_jackknife_knows_the_standard_error_of_a_mean():
    sample = np.array([1.0, 4.0, 2.0, 7.0])
    mean, error = jackknife(lambda x: float(x.mean()), sample)
    assert mean == 3.5
    assert error == pytest.approx(sample.std(ddof=1) / 2.0)


def test_rows_have_names_of_their_own_and_scenarios(tmp_path):
    names = [row.name for row in all_rows()]
    assert len(set(names)) == len(names) > 90
    place = Place(Path("data"), tmp_path, 3, "pmht-paper")
    for row in acceptance_rows.of_the_readme("told") + acceptance_rows.of_aircraft()[:3]:
        scenario = acceptance_rows.scenario_of(row, place)
        assert (scenario.seed, scenario.matcher.name) == (3, "pmht-paper")
