from dataclasses import replace

import numpy as np

from helpers.studies import small_scenario
from isogal.montecarlo import cases
from isogal.montecarlo.cases import Case


def test_key_says_what_the_numbers_depend_on(small_case, field_map):
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


def test_key_depends_on_the_source(small_case, monkeypatch):
    monkeypatch.setattr(cases, "source_digest", lambda: "another")
    assert replace(small_case).key != small_case.key
