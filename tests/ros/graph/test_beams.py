"""An altimeter with several beams: the graph is the library's closed loop, and a bag of it can be
replayed."""

from helpers.node_bench import run_here
from helpers.recordings import record, same
from helpers.sea_floor import DVL, SOUNDING, sea_floor
from isogal.fields.scenario_map import map_for_scenario
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.montecarlo.engine import simulate
from isogal.scenario import load_scenario
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.replay import replay
from isogal_ros.nodes.signals import Interrupt


def test_soundings(tmp_path) -> None:
    keys = DVL, "altimeter.scale_sigma=0.01", "altimeter.max_range=180"
    write_netcdf(sea_floor(), tmp_path / "floor.nc")
    scenario = load_scenario(None, [*SOUNDING, f"map.source={tmp_path / 'floor.nc'}", *keys])
    run_here(scenario, tmp_path / "bag")
    field_map = map_for_scenario(scenario)
    graph = record(tmp_path / "bag", scenario, field_map)
    library = simulate(scenario, [0], field_map)
    assert graph.published.sum() > 1
    same(graph, library, 1e-3)
    reader = BagReader(tmp_path / "bag")
    comparison = replay(reader, Interrupt(), lambda progress: None).comparison
    assert comparison.recorded == comparison.common > 1
    assert comparison.largest_difference < 1e-3
    assert {"/altimeter/points", "/altimeter/footprints"} <= set(reader.types)
