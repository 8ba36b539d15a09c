"""A map that is not what it is assumed to be: what is reported, and what it does."""

from dataclasses import replace

import pytest

from helpers.batches import field_map_of, wavy
from helpers.node_bench import played
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal_ros.faults.campaign import player_of, simulated, two_batches
from isogal_ros.graph.player import Recorded

WRONG = {
    "another area": lambda north, east: wavy(north + 31e3, east - 17e3),
    "another datum": lambda north, east: wavy(north, east) + 5e-4,
}


@pytest.fixture(scope="module")
def feed(scenario) -> Recorded:
    """Eight minutes over the map as it is."""
    own = "matcher.name=pmht", "matcher.batch_length=20", "matcher.stride=5"
    return simulated(scenario("route.duration=480.0", *own), 0)


@pytest.mark.parametrize("what", ["as it is", *WRONG])
def test_a_wrong_map_is_reported_and_does_no_harm(feed, tmp_path, what) -> None:
    taken = feed.scenario
    if what in WRONG:
        path = tmp_path / "wrong.nc"
        write_netcdf(field_map_of(WRONG[what], step=500.0), path)
        taken = taken.model_copy(
            update={"map": taken.map.model_copy(update={"source": str(path)})}
        )
    player = player_of(replace(feed, scenario=taken))
    _, silent = played(player)
    reports = [now for now, text in player.reports if "agree" in text or "lost" in text]
    assert bool(reports) == (what in WRONG)
    assert all(now <= two_batches(taken) for now in reports[:1])
    assert silent == []
