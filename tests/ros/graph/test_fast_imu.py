"""A graph with an IMU of 200 Hz, recorded, and replayed to equal fixes."""

import numpy as np

from helpers.node_bench import run_here
from helpers.recordings import collect, nav_positions, record, same
from isogal.montecarlo.engine import simulate
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.replay import replay
from isogal_ros.nodes.signals import Interrupt


def test_two_hundred_hertz_recorded_and_replayed(scenario, tmp_path) -> None:
    fast = scenario(
        "route.duration=35.0", "gravimeter.interval=5.0", "imu.rate=200.0", "imu.grade=navigation"
    )
    run_here(fast, tmp_path / "bag")
    counts: dict[str, int] = {}
    for item in BagReader(tmp_path / "bag").messages():
        counts[item.topic] = counts.get(item.topic, 0) + 1
    assert counts["/imu/data_raw"] == 7_000
    assert counts["/ground_truth/fix"] == 36
    same(record(tmp_path / "bag", fast), simulate(fast, [0]), 1e-4)
    result = replay(BagReader(tmp_path / "bag"), Interrupt(), lambda progress: None)
    comparison = result.comparison
    assert comparison.recorded == comparison.replayed == comparison.common > 0
    assert comparison.disagreements == 0
    assert comparison.largest_difference < 1e-6
    old, new = collect(tmp_path / "bag"), result.outputs
    np.testing.assert_allclose(nav_positions(old), nav_positions(new), atol=1e-13, rtol=0)
