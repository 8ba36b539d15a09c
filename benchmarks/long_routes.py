"""Memory of runs along routes whose maps do not fit into it: 4,600 km over the synthetic map,
6,000 km over GGMplus tiles.

The tiles are made for the measurement, in a temporary folder (about 250 MB): plane waves of 6 to
60 km. Each run is a process of its own, so that its peak of resident memory is its own::

    python benchmarks/long_routes.py                      # both routes, through the engine
    python benchmarks/long_routes.py --route ggmplus
    python benchmarks/long_routes.py --tiles ggmplus-dg   # only make the tiles, for other runs

The synthetic map's tiles along the route are made first if they are not in the cache folder."""

import argparse
import json
import math
import tempfile
import time
from pathlib import Path

import closed_loop
import numpy as np

from isogal.evaluation.bound import posterior_cramer_rao
from isogal.fields.scenario_map import map_for_scenario
from isogal.maps.channels import channels_of
from isogal.maps.corridor import corridor_of
from isogal.maps.ggmplus.fetch import tiles_for
from isogal.maps.ggmplus.tiles import CELLS, KINDS, STEP_DEG
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory

ROUTES = {
    "synthetic": ((-42.0, 112.0), (-12.0, 145.0)),
    "ggmplus": ((-46.0, 110.0), (-2.0, 145.7)),
}
"""Start and end, deg: oblique, so that the window around a route is far larger than its
corridor."""
SPEED = 220.0
"""m/s; 6,000 km take 7.6 h."""
_WAVES = (6.0, 11.0, 17.0, 25.0, 38.0, 60.0)  # km
_AMPLITUDE = 2e-5  # m/s² of each


def settings(route: str, source: str) -> list[str]:
    """Return the scenario of a route, as changes of the default one."""
    start, end = ROUTES[route]
    return [
        f"map.source={source}",
        "gravimeter.quantity=disturbance",
        f"route.start={list(start)}",
        f"route.end={list(end)}",
        f"route.speed={SPEED}",
        "route.duration=null",
        "route.height=9000",
    ]


def make_tiles(scenario: Scenario, folder: Path) -> None:
    """Write the GGMplus tiles that a scenario's route needs."""
    route = build_trajectory(scenario)
    kind = KINDS["dg"]
    folder.mkdir(parents=True, exist_ok=True)
    for name in tiles_for(corridor_of(route.latitude, route.longitude), ["dg"]):
        south = int(name[1:3]) * (-1 if name[0] == "S" else 1)
        west = int(name[4:7]) * (-1 if name[3] == "W" else 1)
        side = 111.2 * STEP_DEG * (np.arange(CELLS) + 0.5)  # km
        north, east = 111.2 * south + side, 111.2 * west + side
        total = _AMPLITUDE * closed_loop.plane_waves(_WAVES, north, east).T
        np.rint(total / kind.step).astype(kind.dtype).tofile(folder / name)


def run_here(changes: list[str]) -> dict[str, float]:
    """Run a scenario once and return what it took."""
    begun = time.perf_counter()
    scenario = load_scenario(None, changes)
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    ready = time.perf_counter()
    runs = simulate(scenario, [0], field_map)
    done = time.perf_counter()
    bound = posterior_cramer_rao(scenario, trajectory, field_map)
    return {
        "route_km": SPEED * float(trajectory.time[-1]) / 1e3,
        "window_cells": math.prod(channels_of(field_map)[0].shape),
        "peak_mb": closed_loop.peak_memory(),
        "map_s": ready - begun,
        "run_s": done - ready,
        "fixes": int(np.isfinite(runs.fix_error[0, :, 0]).sum()),
        "declined": int(np.isnan(runs.fix_error[0, :, 0]).sum()),
        "fix_ms_median": 1e3 * float(np.median(runs.fix_seconds)),
        "rms_m": float(np.sqrt(np.mean(np.sum(runs.error[0] ** 2, axis=-1)))),
        "unaided_rms_m": float(np.sqrt(np.mean(np.sum(runs.unaided_error[0] ** 2, axis=-1)))),
        "bound_rms_m": float(np.sqrt(np.mean(bound.rms_at(runs.time) ** 2))),
    }


def main() -> None:
    """Run the routes that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--route", choices=sorted(ROUTES), action="append")
    parser.add_argument("--tiles", type=Path, help="only make the GGMplus tiles, in this folder")
    parser.add_argument("--here", nargs="+", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.here:
        print(json.dumps(run_here(chosen.here)))
        return
    if chosen.tiles:
        make_tiles(load_scenario(None, settings("ggmplus", "synthetic")), chosen.tiles)
        return
    for route in chosen.route or sorted(ROUTES):
        with tempfile.TemporaryDirectory() as folder:
            source = "synthetic"
            if route == "ggmplus":
                source = folder
                make_tiles(load_scenario(None, settings(route, source)), Path(folder))
            changes = settings(route, source)
            found = closed_loop.run_apart(__file__, *changes)
        print(f"{route}: {' '.join(changes)}")
        print("  ", ", ".join(f"{name} {value:.6g}" for name, value in found.items()))


if __name__ == "__main__":
    main()
