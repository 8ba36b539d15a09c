"""A graph with several fields, simulated or along a recorded track with recorded readings: a node
for each instrument, one matcher, and the numbers of the library's closed loop."""

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
from isogal.maps.load import load_map
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, validate_scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.plan import Plan, nodes_of
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.security.policy import policy

MGAL = 1e-5
PLACE = {
    "route": {"start": [-36.6, 146.9], "end": [-36.3, 147.2], "duration": 360.0},
    "initial_error": {"position": 200.0},
    "gravity": {"field": "normal"},
    "map": {"continuation": "none"},
    "matcher": {"batch_length": 6, "map_sigma": 0.0},
}
SECOND: dict[str, dict[str, Any]] = {
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
    assert assert_replayed(bag, 1e-3).common > 5
    with pytest.raises(InputError, match=r"fields\.1\.gravimeter\.interval shorter .* \(35 s\)"):
        replayed(bag, two())


def test_a_replay_with_other_settings_is_as_if_they_had_been_run(two, recorded) -> None:
    """Each instrument's own readings are reduced with what the replayed navigator believes."""
    matcher = {"matcher": {"batch_length": 4, "map_sigma": 0.0}}
    scenario = two(matcher, interval=4.0, **matcher)
    assert_replayed_as_run(recorded("second is faster"), scenario, 0.05)


def test_the_policy_names_each_node(two) -> None:
    tree = policy(two())
    found = {
        profile.get("node"): {item.text for item in profile.iter("topic")}
        for profile in tree.getroot().iter("profile")
    }
    assert {"/magnetometer/anomaly", "/gravimeter/disturbance"} <= found[topics.PMHT_MM]
    assert "/magnetometer/anomaly" in found[f"{topics.GRAVIMETER}_magnetic"]
    assert "/magnetometer/anomaly" not in found[topics.GRAVIMETER]


def assert_library(bag: Path, scenario: Scenario) -> None:
    """Rounding in messages decides which hypotheses are split: a centimetre of a fix good to
    20 m."""
    graph, library = record(bag, scenario), simulate(scenario, [0])
    assert graph.published.sum() > 3
    for one in ("error", "posterior_error", "fix_error"):
        there, here = getattr(graph, one), getattr(library, one)
        np.testing.assert_allclose(there, here, atol=0.05, rtol=0, err_msg=one)
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=1e-10, rtol=0)


@pytest.mark.parametrize("name", SECOND)
def test_it_is_the_closed_loop_of_the_library(two, recorded, name) -> None:
    bag = recorded(name)
    assert_library(bag, two(**SECOND[name]))
    heard = {item.topic.lstrip("/") for item in BagReader(bag).messages()}
    assert {"gravimeter/disturbance", "magnetometer/anomaly", "magnetometer/data_raw"} <= heard


@pytest.fixture
def voyage(map_file, magnetic_map, tmp_path) -> Scenario:
    """Gravity and magnetics, read every 10 s, one of them 3.5 s later, along a bent track."""
    time = np.arange(0.0, 361.0, 5.0)
    latitude = -36.6 + 1.4e-4 * time
    longitude = 146.9 + 1.6e-4 * time + 2e-7 * time**2
    rng, rows = np.random.default_rng(3), ["time,latitude,longitude,free_air_anomaly"]
    place = np.radians(latitude), np.radians(longitude)
    gravity = load_map(map_file).value(*place) / MGAL + rng.normal(0.0, 1.0, len(time))
    anomaly = load_map(magnetic_map).value(*place) + rng.normal(0.0, 5.0, len(time))
    for k, t in enumerate(time):
        value = f"{gravity[k]:.4f}" if k % 2 == 0 and k not in (10, 12) else ""
        rows.append(f"{1e9 + t},{latitude[k]:.8f},{longitude[k]:.8f},{value}")
    track, late = tmp_path / "track.csv", tmp_path / "late.csv"
    track.write_text("\n".join(rows))
    seen = [f"{1e9 + t - 3.5},{one:.3f}" for t, one in zip(time, anomaly, strict=True)]
    late.write_text("\n".join(["time,mag", *seen[::2]]))
    magnetic = {
        "field": "magnetic",
        "sigma": 5.0,
        "map": {"source": str(magnetic_map)},
        "readings": {"source": str(late), "column": "mag"},
    }
    along = {"route": {"track": str(track), "height": 100.0}, "readings": {"source": str(track)}}
    gravimeter = {"field": "disturbance", "map": {"source": str(map_file)}}
    return validate_scenario(PLACE | along | {"fields": [gravimeter, magnetic]})


def test_recorded_readings_come_as_late_as_they_were(voyage, tmp_path) -> None:
    run_here(voyage, tmp_path / "bag")
    assert_library(tmp_path / "bag", voyage)
    stamps = [
        peek_ns(item.data) % 10_000_000_000
        for item in BagReader(tmp_path / "bag").messages()
        if item.topic.endswith("magnetometer/anomaly")
    ]
    assert len(stamps) > 30
    assert set(stamps) == {6_500_000_000}
    assert_replayed(tmp_path / "bag", 1e-3)


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
