"""A magnetic vehicle whose own field the matcher estimates from a cold start: the graph is the
library's closed loop, and a bag of it can be replayed."""

import numpy as np

from helpers.magnetics import aircraft
from helpers.node_bench import run_here
from helpers.recordings import collect, nav_positions, record, same
from isogal.fields.scenario_map import map_for_scenario
from isogal.montecarlo.engine import simulate
from isogal.scenario import changed_scenario
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.replay import replay
from isogal_ros.nodes.signals import Interrupt


def test_a_cold_start(magnetic, tmp_path) -> None:
    craft = aircraft()
    scenario = changed_scenario(
        magnetic,
        [
            "matcher.name=pmht",
            "matcher.map_sigma=2",
            "route.duration=400",
            "magnetometer.online=true",
            f"truth.magnetometer.aircraft.permanent={craft.permanent.tolist()}",
            f"truth.magnetometer.aircraft.induced={craft.induced.ravel().tolist()}",
        ],
        "test",
    )
    run_here(scenario, tmp_path / "bag")
    field_map = map_for_scenario(scenario)
    graph = record(tmp_path / "bag", scenario, field_map)
    library = simulate(scenario, [0], field_map)
    assert graph.published.any()
    same(graph, library, 1e-3)
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=1e-6, rtol=0)
    reader = BagReader(tmp_path / "bag")
    comparison = replay(reader, Interrupt(), lambda progress: None).comparison
    assert comparison.recorded == comparison.common > 0
    assert comparison.largest_difference < 1e-3
    assert "/magnetometer/terms" in reader.types
    # the readings of both instruments are reduced anew for a matcher that does otherwise
    other = changed_scenario(scenario, ["matcher.map_sigma=4"], "test")
    result = replay(BagReader(tmp_path / "bag"), Interrupt(), lambda progress: None, other)
    run_here(other, tmp_path / "other")
    ran = collect(tmp_path / "other")
    np.testing.assert_allclose(nav_positions(result.outputs), nav_positions(ran), atol=1e-12)
