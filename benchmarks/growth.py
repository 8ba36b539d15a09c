"""How CPU time and memory grow: with runs, workers, length of the route, nodes of the map, length
of a batch, each with its exponent.

    python benchmarks/growth.py                  # all, some minutes
    python benchmarks/growth.py --only runs      # one of them

Each size is a process of its own, so that its CPU time and its peak of memory are its own; those
of the workers are added up. The exponent is the slope of the logarithms over the larger half of
the sizes; memory is what comes on top of the imported program. The routes of up to 6,000 km lie
over GGMplus tiles that are made first, in a temporary folder (250 MB)."""

import argparse
import json
import math
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing import forkserver
from pathlib import Path

import closed_loop
import numpy as np
from long_routes import make_tiles
from long_routes import settings as long_route

from isogal.fields.scenario_map import map_for_scenario, maps_for_scenario
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.montecarlo.chunks import Case
from isogal.montecarlo.engine import simulate
from isogal.montecarlo.progress import LiveProgress
from isogal.montecarlo.store import Store
from isogal.montecarlo.study import Backend, compute_cases
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory

SHORT = ["route.duration=1800", "gravity.field=normal", "matcher.map_sigma=0"]
"""Half an hour of the default scenario, 35 batches of 30 readings, one each 50 s."""
LONG = ["gravity.field=normal", "matcher.map_sigma=0", "matcher.stride=30"]
SIDES = 40.0, 90.0
"""km north and east, of the map about half an hour of the default route."""
WAVES = 3.0, 5.0, 9.0, 16.0, 30.0
"""km, of that map."""


@dataclass(frozen=True)
class Axis:
    """What grows."""

    title: str
    sizes: tuple[int, ...]
    unit: str = ""


AXES = {
    "runs": Axis("runs, in one process", (4, 8, 16, 32, 64)),
    "workers": Axis("workers, 16 runs in all", (1, 2, 4)),
    "route": Axis("length of the route", (300, 600, 1500, 3000, 6000), " km"),
    "nodes": Axis("nodes of the map about a route", (400, 1600, 6400, 12800), " thousand"),
    "batch": Axis("readings in a batch, a fix every five", (8, 15, 30, 60, 120)),
    "start": Axis("start known to so many m", (50, 500, 1000, 5000), " m"),
}


def make_map(path: Path, thousands: int) -> None:
    """Write a map of so many thousand nodes: plane waves, about the default route."""
    route = build_trajectory(load_scenario(None, SHORT))
    rows, columns = (
        round(math.sqrt(1e3 * thousands) * math.sqrt(side / other))
        for side, other in (SIDES, SIDES[::-1])
    )
    north, east = (
        side * np.linspace(-0.5, 0.5, count)
        for side, count in zip(SIDES, (rows, columns), strict=True)
    )
    values = 9.8 + 1e-5 * closed_loop.plane_waves(WAVES, north, east)
    middle = len(route.latitude) // 2
    latitude = route.latitude[middle] + north / 6371.0
    longitude = route.longitude[middle] + east / 6371.0 / math.cos(route.latitude[middle])
    write_netcdf(FieldMap(latitude, longitude, values, "m/s²", "gravity"), path)


def case(name: str, size: int, folder: Path) -> tuple[Scenario, int]:
    """Return scenario and number of runs."""
    runs, changes = 4, list(SHORT)
    if name == "runs":
        runs = size
    elif name == "workers":
        runs = 16
    elif name == "route":
        runs, changes = 1, long_route("ggmplus", str(folder)) + LONG
        # at the height that the map holds at: else parts of it are continued, which takes longer
        changes += [f"route.duration={1e3 * size / 220.0}", "route.height=0"]
    elif name == "nodes":
        changes += [f"map.source={folder / 'map.nc'}"]
    elif name == "batch":
        changes += [f"matcher.batch_length={size}", "matcher.stride=5"]
    else:
        changes += [f"initial_error.position={size}"]
    return load_scenario(None, changes), runs


def measure(name: str, size: int, folder: Path) -> dict[str, float]:
    """Compute one size here; return CPU seconds and the growth of the peak of memory, MB."""
    before = closed_loop.peak_memory()
    scenario, runs = case(name, size, folder)
    begun = time.process_time()
    if name == "workers":
        field_map = maps_for_scenario(scenario, build_trajectory(scenario))
        given = Case("growth", scenario, runs, field_map)
        with LiveProgress("growth") as display, tempfile.TemporaryDirectory() as kept:
            compute_cases([given], Store(Path(kept)), Backend(workers=size), display)
        forkserver._forkserver._stop()  # of which the workers' CPU time is known once it has ended
    else:
        simulate(scenario, range(runs), map_for_scenario(scenario, build_trajectory(scenario)))
    below = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = time.process_time() - begun + below.ru_utime + below.ru_stime
    workers = size * below.ru_maxrss / 1024.0 if name == "workers" else 0.0
    return {"cpu_s": cpu, "memory_mb": closed_loop.peak_memory() - before + workers}


def exponent(sizes: Sequence[int], values: Sequence[float]) -> float:
    """Return the slope of the logarithms over the larger half of the sizes."""
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(values[half:]), 1)[0])


def row(axis: Axis, found: list[dict[str, float]]) -> str:
    """Return the table's row of one axis."""
    cpu, memory = ([one[key] for one in found] for key in ("cpu_s", "memory_mb"))
    times = ", ".join(f"{value / cpu[0]:.3g}" for value in cpu)
    megabytes = ", ".join(f"{value:.0f}" for value in memory)
    sizes = ", ".join(f"{size:,}" for size in axis.sizes) + axis.unit
    return (
        f"| {axis.title} | {sizes} | {times} | {exponent(axis.sizes, cpu):.2f} | {megabytes} |"
        f" {exponent(axis.sizes, memory):.2f} |"
    )


def grow(name: str) -> str:
    """Measure one axis; return its row."""
    axis, found = AXES[name], []
    with tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        if name == "route":
            make_tiles(load_scenario(None, long_route("ggmplus", "synthetic")), folder)
        for size in (axis.sizes[0], *axis.sizes):  # the first once more: it may have compiled
            if name == "nodes":
                make_map(folder / "map.nc", size)
            found.append(closed_loop.run_apart(__file__, name, str(size), str(folder)))
            print(name, size, found[-1], file=sys.stderr)
    return row(axis, found[1:])


def main() -> None:
    """Measure what is asked for; print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", choices=sorted(AXES), action="append")
    parser.add_argument("--here", nargs=3, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.here:
        name, size, folder = chosen.here
        print(json.dumps(measure(name, int(size), Path(folder))))
        return
    print("| what grows | sizes | CPU time, first = 1 | exponent | memory (MB) | exponent |")
    print("|---|---|---|---|---|---|")
    for name in chosen.only or AXES:
        print(grow(name), flush=True)


if __name__ == "__main__":
    main()
