"""A graph with several fields: a node for each instrument, one matcher, and the numbers of the
library's closed loop."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from helpers.node_bench import run_here
from helpers.recordings import assert_replayed, assert_replayed_as_run, record, replayed
from isogal.errors import InputError
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, validate_scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.plan import Plan, nodes_of
from isogal_ros.security.policy import policy

PLACE = {
    "route": {"start": [-36.6, 146.9], "end": [-36.3, 147.2], "duration": 360.0},
    "initial_error": {"position": 200.0},
    "gravity": {"field": "normal"},
    "map": {"continuation": "none"},
    "matcher": {"batch_length": 6, "map_sigma": 0.0},
}
SECOND: dict[str, dict[str, Any]] = {
    "one rate": {},
    "second is faster": {"interval": 4.0},
    "second misses the batch ends": {"interval": 35.0, "matcher": {"batch_length": 3}},
}


@pytest.fixture(scope="module")
def two(map_file, magnetic_map) -> Callable[..., Scenario]:
    """Scenarios of gravity and magnetics over made-up maps; keys of the second entry."""

    def make(first: dict | None = None, **second) -> Scenario:
        gravity = {"field": "disturbance", "map": {"source": str(map_file)}} | (first or {})
        source = {"source": str(magnetic_map)}
        magnetic = {"field": "magnetic", "sigma": 5.0, "map": source} | second
        return validate_scenario(PLACE | {"fields": [gravity, magnetic]})

    return make


@pytest.fixture(scope="module")
def recorded(two, tmp_path_factory) -> Callable[[str], Path]:
    """The recording of a graph, by what the second entry is."""

    @cache
    def make(name: str) -> Path:
        bag = tmp_path_factory.mktemp("run") / "bag"
        run_here(two(**SECOND[name]), bag)
        return bag

    return make


def test_a_recording_is_replayed(two, recorded) -> None:
    """The fixes of a graph with several fields, from its readings."""
    bag = recorded("second misses the batch ends")
    assert assert_replayed(bag, 1e-3).comparison.common > 5
    with pytest.raises(InputError, match=r"fields\.1\.gravimeter\.interval shorter .* \(35 s\)"):
        replayed(bag, two())


def test_a_replay_with_other_settings_is_as_if_they_had_been_run(two, recorded, tmp_path) -> None:
    """Each instrument's own readings are reduced with what the replayed navigator believes."""
    matcher = {"matcher": {"batch_length": 4, "map_sigma": 0.0}}
    scenario, bag = two(matcher, **matcher), recorded("one rate")
    run_here(scenario, tmp_path / "bag")
    assert_replayed_as_run(bag, scenario, tmp_path / "bag")


def test_the_policy_names_each_node(two) -> None:
    tree = policy(two())
    found = {
        profile.get("node"): {item.text for item in profile.iter("topic")}
        for profile in tree.getroot().iter("profile")
    }
    assert {"magnetometer/anomaly", "gravimeter/disturbance"} <= found[topics.PMHT_MM]
    assert "magnetometer/anomaly" in found[f"{topics.GRAVIMETER}_magnetic"]
    assert "magnetometer/anomaly" not in found[topics.GRAVIMETER]


@pytest.mark.parametrize("name", SECOND)
def test_it_is_the_closed_loop_of_the_library(two, recorded, name) -> None:
    bag, scenario = recorded(name), two(**SECOND[name])
    graph, library = record(bag, scenario), simulate(scenario, [0])
    assert len(graph.fix_time) > 5
    assert graph.published.any()
    # rounding in messages decides which hypotheses are split: a centimetre of a fix good to 20 m
    for one in ("error", "posterior_error", "fix_error"):
        there, here = getattr(graph, one), getattr(library, one)
        np.testing.assert_allclose(there, here, atol=0.05, rtol=0, err_msg=one)
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=1e-10, rtol=0)
    heard = {item.topic.lstrip("/") for item in BagReader(bag).messages()}
    assert {"gravimeter/disturbance", "magnetometer/anomaly", "magnetometer/data_raw"} <= heard


def test_each_field_has_a_node_that_is_told_its_own_entry(two) -> None:
    plan = Plan(two(), None)
    second = f"{topics.GRAVIMETER}_magnetic"
    assert plan.names == nodes_of(plan.scenario)
    assert set(plan.names) == {*topics.NODES, second}
    assert {topics.kind_of(name) for name in plan.names} == set(topics.NODES)
    assert plan.values(topics.GRAVIMETER)["field"] == "disturbance"
    values = plan.values(second)
    assert (values["field"], values["gravimeter.sigma"]) == ("magnetic", 5.0)
    assert "fields" not in values
    assert set(values["peers"]) == set(plan.names)
    entries = yaml.safe_load(plan.values(topics.PMHT_MM)["fields"])
    assert [one["field"] for one in entries] == ["disturbance", "magnetic"]


def test_an_instrument_has_one_node(two, map_file) -> None:
    other = {"field": "gravity", "map": {"source": str(map_file)}}
    scenario = validate_scenario(PLACE | {"fields": [two().fields[0], other]})
    with pytest.raises(InputError, match="disturbance and gravity are readings of one gravimeter"):
        nodes_of(scenario)
