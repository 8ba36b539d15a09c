"""Worlds drawn at random: what is drawn is a scenario, and the same again."""

from pathlib import Path

import worlds

from isogal.scenario import load_scenario

DATA = Path("data")


def test_every_world_is_a_scenario_and_the_same_again():
    drawn = [worlds.world(1, number, DATA) for number in range(200)]
    assert drawn == [worlds.world(1, number, DATA) for number in range(200)]
    assert len({name for name, _ in drawn}) > 190
    for name, keys in drawn:
        scenario = load_scenario(None, keys)
        for fault in set(worlds.FAULTS) & set(name.split(", ")):
            assert scenario.truth or "outliers" in fault or "missing" in fault or "tails" in fault
    for words in (*worlds.FAULTS, "magnetic", "legs of 20 km", "barometer", "satellites at first"):
        assert any(words in name for name, _ in drawn)


def test_only_worlds_that_are_far_off_or_too_sure_are_listed():
    good = {"ratio": 1.0, "nees_settled": 1.0, "rms": 10.0, "bound": 10.0}
    found = [
        ("good", good),
        ("far", good | {"ratio": 2.1}),
        ("sure", good | {"nees_settled": 3.1}),
    ]
    lines = worlds.table_of(found).splitlines()
    assert [line.split("|")[1].strip() for line in lines[-2:]] == ["sure", "far"]
    assert not any(line.startswith("| good") for line in lines)
