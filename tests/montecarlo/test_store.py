from dataclasses import replace

import pytest

from helpers.studies import same_runs, small_scenario
from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.montecarlo.cases import Case, Job
from isogal.montecarlo.engine import simulate
from isogal.montecarlo.store import Store

CASE_RUNS = 5


@pytest.fixture(scope="module")
def case(field_map):
    return Case("stored", small_scenario(route={"duration": 300.0}), CASE_RUNS, field_map)


@pytest.fixture(scope="module")
def whole(case):
    return simulate(case.scenario, range(CASE_RUNS), case.field_map)


def fill(store, case, runs):
    for run in runs:
        store.put(Job(case, run), simulate(case.scenario, [run], case.field_map))


def test_what_is_kept_is_what_was_computed(tmp_path, case, whole):
    store = Store(tmp_path)
    assert store.missing(case) == list(range(5))
    fill(store, case, (3, 4, 0, 1, 2))
    assert store.missing(case) == []
    same_runs(store.load(case), whole)


def test_fewer_and_more_runs_use_what_is_there(tmp_path, case, whole):
    store = Store(tmp_path)
    fill(store, case, range(3))
    same_runs(store.load(replace(case, runs=2)), whole.part(range(2)))
    assert store.missing(replace(case, runs=5)) == [3, 4]
    with pytest.raises(InputError, match=r"000003\.npz: cannot be read: No such file"):
        store.load(case)


def test_damaged_file_is_computed_again(tmp_path, case, whole):
    store = Store(tmp_path)
    fill(store, case, range(5))
    (path,) = tmp_path.rglob("000002.npz")
    path.write_bytes(path.read_bytes()[:-1000])
    assert store.missing(case) == [2]
    assert len(store.damaged) == 1
    assert "000002" in store.damaged[0]
    fill(store, case, range(2, 3))
    same_runs(store.load(case), whole)


def test_details_are_those_of_run_0(tmp_path, case):
    store = Store(tmp_path)
    fill(store, case, range(4))
    found = [Runs.load(path).detail for path in sorted(tmp_path.rglob("*.npz"))]
    assert [detail is None for detail in found] == [False, True, True, True]
