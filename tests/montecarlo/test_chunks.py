from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.studies import small_scenario
from isogal.maps.field_map import FieldMap
from isogal.montecarlo import chunks
from isogal.montecarlo.chunks import MOST_RUNS, Case, divide, fair_share, fitting


@given(
    missing=st.sets(st.integers(0, 300)),
    share=st.integers(1, 40),
    memory=st.integers(10**5, 10**8),
)
def test_chunks_cover_what_is_missing_once(
    small_case: Case, missing: set[int], share: int, memory: int
) -> None:
    with patch.object(chunks, "MEMORY", memory):
        parts = divide(small_case, sorted(missing), share)
        most = min(share, fitting(small_case.scenario, 600.0))
    assert [run for part in parts for run in part.runs] == sorted(missing)
    assert divide(small_case, [], share) == []
    assert all(1 <= len(part.runs) <= most for part in parts)


def test_shares() -> None:
    assert [fair_share(runs, 2) for runs in (1, 8, 100, 10_000)] == [1, 1, 7, MOST_RUNS]


def test_long_fast_runs_are_computed_few_at_a_time() -> None:
    scenario = small_scenario(imu={"rate": 100.0}, route={"duration": 27000.0})
    assert fitting(scenario, 27000.0) == 1
    assert fitting(small_scenario(), 12960.0) > 50
    with_error = small_scenario(map_error={"sigma": 1e-5})
    assert fitting(with_error, 12960.0) < fitting(small_scenario(), 12960.0)


def test_key_says_what_the_numbers_depend_on(small_case: Case, field_map: FieldMap) -> None:
    same = Case("other name", small_scenario(), 400, field_map)
    assert same.key == small_case.key
    promising = replace(small_case, scenario=small_scenario(integrity={"risk": 1e-3}))
    assert promising.key == small_case.key
    changed = [
        replace(small_case, scenario=small_scenario(seed=1)),
        replace(
            small_case,
            scenario=small_scenario(matcher={"name": "pmht-paper", "options": {"gamma": 8.0}}),
        ),
        replace(small_case, aided=False),
        replace(small_case, field_map=replace(field_map, values=field_map.values + 1e-9)),
        replace(small_case, field_map=replace(field_map, quantisation=1e-6)),
        replace(
            small_case, field_map=replace(field_map, sigma=np.full(field_map.values.shape, 1e-5))
        ),
    ]
    keys = [case.key for case in changed]
    assert small_case.key not in keys
    assert len(set(keys)) == len(keys)


def test_key_depends_on_the_source(small_case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "source_digest", lambda: "another")
    assert replace(small_case).key != small_case.key
