"""`make accept`: a row is measured, and set beside the one that was kept."""

from concurrent.futures import Executor, Future
from pathlib import Path

import acceptance
import acceptance_rows
import numpy as np
import pytest
from acceptance_figures import compared, jackknife, rms
from acceptance_rows import Place, Row, all_rows
from acceptance_table import print_table

from helpers.batches import ORIGIN
from isogal.errors import InputError
from isogal.matching import map_matching
from isogal.scenario import load_scenario

KEPT = {
    "seed": 1,
    "rms": 10.0,
    "rms_of_run": [9.0, 10.0, 11.0, 10.0, 9.5],
    "nees_of_run": [0.9, 1.0, 1.1, 1.0, 0.9],
}


class Here(Executor):
    """Does jobs at once, in this process."""

    def submit(self, work, /, *arguments):
        job = Future()
        try:
            job.set_result(work(*arguments))
        except Exception as error:
            job.set_exception(error)
        return job


def tiny(place):
    ends = f"route.start={np.degrees(ORIGIN).tolist()}", "route.end=[-36.4, 147.2]"
    return load_scenario(None, [*ends, "route.duration=900", "gravity.field=normal"])


@pytest.fixture
def place(tmp_path):
    return Place(tmp_path, tmp_path / "made", 7)


def measured(monkeypatch, place, runs=3, **more):
    row = Row("tiny", **{"make": tiny, "needs": (), "settled": 300.0, "minutes": (10,)} | more)
    monkeypatch.setattr(acceptance, "all_rows", lambda: [row])
    return acceptance.measure(row, place, runs, Here())


def test_a_row_has_all_figures_and_cells(monkeypatch, place, capsys):
    clock = map_matching.clock
    row = measured(monkeypatch, place)
    assert map_matching.clock is clock
    assert (row["runs"], row["seed"], row["failed_fixes"]) == (3, 7, 0)
    assert len(row["rms_of_run"]) == len(row["nees_of_run"]) == 3
    assert row["rms"] == pytest.approx(rms(np.array(row["rms_of_run"])), rel=1e-3)
    assert 0.0 < row["fix_ms"]["median"] <= row["fix_ms"]["p99"] <= row["fix_ms"]["max"]
    assert row["run_hours_per_cpu_s"] > 0.0
    assert row["memory_mb"] > 50.0
    print_table({"tiny": row, "other": {"skipped": "no file"}}, {"tiny": row})
    assert "1.000±0.000" in capsys.readouterr().out
    fewer = measured(monkeypatch, place, runs=2)  # other jobs, the same runs
    assert fewer["rms_of_run"] == row["rms_of_run"][:2]


def test_what_cannot_be_measured_says_why(monkeypatch, place):
    assert "no away.nc" in measured(monkeypatch, place, needs=("away.nc",))["skipped"]

    def refused(_place):
        raise InputError("no such key")

    row = measured(monkeypatch, place, make=refused)
    assert row == {"failed": "InputError: no such key"}
    assert compared(row, KEPT).worse == ("failed",)


def test_finished_rows_are_taken_from_their_files(monkeypatch, place):
    options = acceptance.arguments(["--workers", "1"])
    place.out.mkdir()
    row = next(row for row in all_rows() if isinstance(row, Row))
    monkeypatch.setattr(acceptance, "measure", lambda *_: dict(KEPT))
    assert acceptance.kept_or_measured(row, place, 2, options) == KEPT
    monkeypatch.setattr(acceptance, "measure", lambda *_: {"failed": "computed again"})
    assert acceptance.kept_or_measured(row, place, 2, options) == KEPT
    assert "failed" in acceptance.kept_or_measured(row, place, 3, options)
    options.again = True
    assert "failed" in acceptance.kept_or_measured(row, place, 2, options)


def changed(**more):
    return KEPT | more


def test_pairs_of_runs_show_a_small_loss():
    def times(factor):
        return changed(rms_of_run=[factor * x for x in KEPT["rms_of_run"]])

    assert compared(KEPT, KEPT).worse == ()
    assert compared(times(1.02), KEPT).worse == ()
    worse = compared(times(1.04), KEPT)
    assert worse.ratio == pytest.approx(1.04)
    assert worse.ratio_error == pytest.approx(0.0, abs=1e-9)
    assert worse.worse == ("RMS",)
    assert compared(changed(rms_of_run=times(1.04)["rms_of_run"][:2]), KEPT).worse == ("RMS",)
    other_seed = compared(times(1.04) | {"seed": 2}, KEPT)
    assert other_seed.ratio_error > 0.04
    assert other_seed.worse == ()
    noisy = changed(rms_of_run=[9.0, 10.0, 13.0, 10.0, 9.5])
    assert compared(noisy, KEPT).ratio > 1.04
    assert compared(noisy, KEPT).worse == ()


def test_nees_and_starts_found_count_too():
    assert compared(changed(nees_of_run=[1.2, 1.2, 1.25, 1.2, 1.2]), KEPT).worse == ("NEES",)
    assert compared(changed(nees_of_run=[0.7, 0.8, 0.85, 0.8, 0.7]), KEPT).worse == ("NEES",)
    assert compared(changed(nees_of_run=[1.0, 1.05, None, 1.0, 1.0]), KEPT).worse == ()
    starts = changed(found={"60": 0.9, "75": 1.0})
    assert compared(starts | {"found": {"60": 0.5, "75": 0.9}}, starts).worse == ("found",)
    assert compared(starts | {"found": {"60": 0.5, "75": 1.0}}, starts).worse == ()


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
