from dataclasses import replace

import pytest

from helpers.studies import same_runs, small_scenario
from isogal.errors import InputError
from isogal.evaluation.records import Runs
from isogal.montecarlo.cases import Case, Job
from isogal.montecarlo.engine import simulate
from isogal.montecarlo.store import Store

CASE_RUNS = 3


@pytest.fixture(scope="module")
def case(field_map):
    return Case("stored", small_scenario(route={"duration": 300.0}), CASE_RUNS, field_map)


@pytest.fixture(scope="module")
def whole(case):
    return simulate(case.scenario, range(CASE_RUNS), case.field_map)


def fill(store, case, runs):
    for run in runs:
        store.put(Job(case, run), simulate(case.scenario, [run], case.field_map))


def test_fewer_and_more_runs_use_what_is_there_and_only_the_first_has_details(
    tmp_path, case, whole
):
    store = Store(tmp_path)
    assert store.missing(case) == [0, 1, 2]
    fill(store, case, (1, 0))
    same_runs(store.load(replace(case, runs=2)), whole.part(range(2)))
    assert store.missing(case) == [2]
    with pytest.raises(InputError, match=r"000002\.npz: cannot be read: No such file"):
        store.load(case)
    found = [Runs.load(path).detail for path in sorted(tmp_path.rglob("*.npz"))]
    assert [detail is None for detail in found] == [False, True]


def test_damaged_file_is_computed_again(tmp_path, case, whole):
    store = Store(tmp_path)
    fill(store, case, range(3))
    (path,) = tmp_path.rglob("000002.npz")
    path.write_bytes(path.read_bytes()[:-1000])
    assert store.missing(case) == [2]
    fill(store, case, [2])
    same_runs(store.load(case), whole)
