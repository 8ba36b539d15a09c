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
