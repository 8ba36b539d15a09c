from dataclasses import replace

import numpy as np

from helpers.studies import small_scenario
from isogal.maps.several import FieldMaps
from isogal.montecarlo import cases
from isogal.montecarlo.cases import Case


def test_key_says_what_the_numbers_depend_on(small_case, field_map, monkeypatch):
    same = Case("other name", small_scenario(integrity={"risk": 1e-3}), 400, field_map)
    assert same.key == small_case.key

    def of(**scenario):
        return replace(small_case, scenario=small_scenario(**scenario))

    def on(its_map):
        return replace(small_case, field_map=its_map)

    rounded = replace(field_map, quantisation=1e-6)
    changed = [
        of(seed=1),
        of(matcher={"name": "pmht-paper", "options": {"gamma": 8.0}}),
        replace(small_case, aided=False),
        on(replace(field_map, values=field_map.values + 1e-9)),
        on(replace(field_map, sigma=np.full(field_map.values.shape, 1e-5))),
        on(rounded),
        on(FieldMaps((field_map, field_map))),
        on(FieldMaps((field_map, rounded))),
    ]
    keys = {case.key for case in changed}
    monkeypatch.setattr(cases, "source_digest", lambda: "another")
    assert len(keys | {small_case.key, replace(small_case).key}) == len(changed) + 2
