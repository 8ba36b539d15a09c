"""The benchmark of the graph."""

import graph
from clock import Clock

from helpers.node_bench import bench
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.graph.bus import Bus


def test_what_nodes_take_and_publish_is_timed(monkeypatch):
    """It ended with an AttributeError, once all other runs were over."""
    for name in ("join", "send"):
        monkeypatch.setattr(Bus, name, getattr(Bus, name))
    clock = Clock()
    graph.watch_callbacks(clock)
    scenario = Scenario.model_validate({"gravity": {"field": "normal", "compensation": "none"}})
    with bench(topics.UKF_FUSION, scenario) as made:
        made.imu(1.0)
    assert len(clock.calls["ukf_fusion_node: imu/data_raw"]) == 1
    assert clock.calls[graph.PUBLISH]
