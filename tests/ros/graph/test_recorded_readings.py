"""A graph along a recorded track with recorded readings: the numbers of the library's closed
loop."""

import numpy as np
import pytest

from helpers.node_bench import run_here
from helpers.recordings import assert_replayed, record
from isogal.maps.load import load_map
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, validate_scenario
from isogal_ros.bags.reader import BagReader
from isogal_ros.messages.stamps import peek_ns

MGAL = 1e-5


@pytest.fixture
def scenario(map_file, magnetic_map, tmp_path) -> Scenario:
    """Gravity and magnetics, read every 10 s, one of them 3.5 s later, along a bent track."""
    time = np.arange(0.0, 361.0, 5.0)
    latitude = -36.6 + 1.4e-4 * time
    longitude = 146.9 + 1.6e-4 * time + 2e-7 * time**2
    rng, rows = np.random.default_rng(3), ["time,latitude,longitude,free_air_anomaly,residual"]
    place = np.radians(latitude), np.radians(longitude)
    gravity = load_map(map_file).value(*place) / MGAL + rng.normal(0.0, 1.0, len(time))
    anomaly = load_map(magnetic_map).value(*place) + rng.normal(0.0, 5.0, len(time))
    for k, t in enumerate(time):
        value = f"{gravity[k]:.4f}" if k % 2 == 0 and k not in (10, 12) else ""
        rows.append(f"{1e9 + t},{latitude[k]:.8f},{longitude[k]:.8f},{value},{anomaly[k]:.3f}")
    track = tmp_path / "track.csv"
    track.write_text("\n".join(rows))
    late = tmp_path / "late.csv"
    seen = [f"{1e9 + t - 3.5},{one:.3f}" for t, one in zip(time, anomaly, strict=True)]
    late.write_text("\n".join(["time,mag", *seen[::2]]))
    return validate_scenario(
        {
            "route": {"track": str(track), "height": 100.0},
            "initial_error": {"position": 200.0},
            "gravity": {"field": "normal"},
            "map": {"continuation": "none"},
            "matcher": {"batch_length": 6, "map_sigma": 0.0},
            "readings": {"source": str(track)},
            "fields": [
                {"field": "disturbance", "map": {"source": str(map_file)}},
                {
                    "field": "magnetic",
                    "sigma": 5.0,
                    "map": {"source": str(magnetic_map)},
                    "readings": {"source": str(late), "column": "mag"},
                },
            ],
        }
    )


def test_a_graph_on_recorded_readings_is_the_closed_loop_of_the_library(scenario, tmp_path):
    run_here(scenario, tmp_path / "bag")
    graph, library = record(tmp_path / "bag", scenario), simulate(scenario, [0])
    assert graph.published.sum() > 3
    for one in ("error", "posterior_error", "fix_error"):
        there, here = getattr(graph, one), getattr(library, one)
        np.testing.assert_allclose(there, here, atol=0.05, rtol=0, err_msg=one)
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=1e-10, rtol=0)
    stamps = [
        peek_ns(item.data) % 10_000_000_000
        for item in BagReader(tmp_path / "bag").messages()
        if item.topic.endswith("magnetometer/anomaly")
    ]
    assert len(stamps) > 30
    assert set(stamps) == {6_500_000_000}
    assert_replayed(tmp_path / "bag", 1e-3)
