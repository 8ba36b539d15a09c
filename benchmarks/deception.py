"""How soon false satellites are found out, and what they have done by then.

    python benchmarks/deception.py --data DIR [--runs 8] [--rows TEXT ...]
        [--page docs/evidence/deception.md]
    python benchmarks/deception.py --data DIR --false-alarms HOURS

A voyage with satellites all the time, which are deceived from 45 minutes on, for good or for 3 or
15 minutes, or from the first minute. For each grade of the inertial sensors: time until the
navigator says so, its largest error meanwhile, its error at the end beside that of the same runs
without satellites, and how many were missed. Without deception, false alarms, also with errors of
satellites three times as large as told (other paths of their signals), and with outages.

With --false-alarms honest satellites alone, in so many hours altogether, without matching: there
the monitor judges by inertial data, and what the map says is not asked."""

from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import closed_loop  # first: it asks NumPy for one thread
import numpy as np
from acceptance_rows import AUSTRALIA

from isogal.earth.frames import horizontal_difference
from isogal.fields.scenario_map import maps_for_scenario
from isogal.matching.registry import build_run_matcher
from isogal.montecarlo.engine import Simulation
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory

MARKS = closed_loop.marks_of(__file__)
START, DURATION = 2700.0, 7200.0
WITHIN = "gnss.available=[[0, 7200]]"
GRADES = "precision", "quantum", "navigation", "tactical"
KINDS = {
    "walk, 0.3 m/s": (START, "kind=walk", "rate=0.3"),
    "walk, 1 m/s": (START, "kind=walk", "rate=1"),
    "walk, 3 m/s": (START, "kind=walk", "rate=3"),
    "jump of 100 m": (START, "kind=jump", "size=100"),
    "jump of 1 km": (START, "kind=jump", "size=1000"),
    "4 s late": (START, "kind=delay", "size=4"),
    "walk, 1 m/s, for 180 s": (START, "kind=walk", "rate=1", f"end={START + 180.0}"),
    "walk, 1 m/s, for 900 s": (START, "kind=walk", "rate=1", f"end={START + 900.0}"),
    "jump of 100 m, for 180 s": (START, "kind=jump", "size=100", f"end={START + 180.0}"),
    "jump of 100 m, for 900 s": (START, "kind=jump", "size=100", f"end={START + 900.0}"),
    "200 m off from the first minute": (0.0, "kind=jump", "size=200"),
}
"""When it begins (s), and keys of `gnss.deception`."""
SLOW = "walk, 0.3 m/s", "200 m off from the first minute"
"""Kinds that need not be found: slower than 1 m/s, or nothing to compare with."""
HONEST = {
    "honest": (),
    "honest, errors 3 x": ("truth.gnss.correlated_sigma=3x", "truth.gnss.position_sigma=3x"),
    "honest, outages": ("gnss.available=[[0, 1200], [2400, 2700], [4200, 7200]]",),
}
COLUMNS = {
    "found of": "{found} of {runs}",
    "after, s": "{after:.0f}",
    "largest error till then, m": "{largest:.0f}",
    "error at the end, m": "{end:.0f}",
    "without satellites, m": "{without:.0f}",
}


class Outcome(NamedTuple):
    """Of one run."""

    after: float
    """s from the beginning of the deception until it was found; NaN = it was not."""
    largest: float
    """m, largest error until then, or to the end."""
    end: float
    """m, RMS error of the last quarter."""


def judged(scenario: Scenario, since: float, run: int) -> Outcome:
    """Navigate one run, and return what became of it."""
    trajectory = build_trajectory(scenario)
    maps = maps_for_scenario(scenario, trajectory)
    simulation = Simulation(scenario, [run], trajectory, maps)
    navigator = simulation.navigator(0, build_run_matcher(scenario))
    aids = simulation.measurements(0)
    error, found = [], np.nan
    scans = range(simulation.scans + 1)
    for before, scan in pairwise(scans):
        simulation.advance(navigator, 0, before, scan, aids)
        simulation.read(navigator, 0, before, scan)
        navigator.fix()
        k, place = simulation.index[scan], navigator.state.position[:2]
        apart = horizontal_difference(*place, trajectory.latitude[k], trajectory.longitude[k])
        error.append(float(np.hypot(*apart)))
        monitor = navigator.inertial.monitors.get("gnss")
        if monitor is not None and np.isnan(found) and monitor.detected >= since:
            found = monitor.detected
    times = trajectory.time[simulation.index[1:]]
    errors = np.array(error)
    meanwhile = (times >= max(since, 60.0)) & (np.isnan(found) | (times <= found))
    end = closed_loop.rms(errors[times > 0.75 * times[-1]])
    return Outcome(found - since, float(errors[meanwhile].max(initial=0.0)), end)


def alarms(scenario: Scenario, run: int) -> int:
    """Navigate one run by satellites alone, and return how often they were called wrong."""
    trajectory = build_trajectory(scenario)
    maps = maps_for_scenario(scenario, trajectory)
    simulation = Simulation(scenario, [run], trajectory, maps)
    navigator = simulation.navigator(0, build_run_matcher(scenario))
    aids = simulation.measurements(0)
    found = set()
    for before, scan in pairwise(range(simulation.scans + 1)):
        simulation.advance(navigator, 0, before, scan, aids)
        found |= {one.wrong_since for one in navigator.inertial.monitors.values()}
    return len(found - {None})


def row_of(
    scenario: Scenario, since: float, runs: int, pool: ProcessPoolExecutor
) -> Mapping[str, float]:
    """Return the figures of a row."""
    each = np.array(list(pool.map(partial(judged, scenario, since), range(runs))))
    after, largest, end = each.T
    there = np.isfinite(after)
    return {
        "runs": runs,
        "found": int(there.sum()),
        "after": float(np.median(after[there])) if there.any() else np.nan,
        "largest": float(largest.max()),
        "end": closed_loop.rms(end),
    }


def rows_of(base: list[str]) -> dict[str, tuple[Scenario, float]]:
    """Return scenarios by their names, and the time (s) from when on satellites are wrong."""
    rows: dict[str, tuple[Scenario, float]] = {}
    for name, (start, *more) in KINDS.items():
        keys = [f"gnss.deception.{key}" for key in (f"start={start}", *more)]
        rows[name] = load_scenario(None, [*base, WITHIN, *keys]), start
    for name, keys in HONEST.items():
        rows[name] = load_scenario(None, [*base, WITHIN, *keys]), 0.0
    return rows


def count_alarms(base: list[str], hours: float, workers: int) -> None:
    """Print how often honest satellites are called wrong, in an equal share of the hours for each
    grade and each kind of honest satellites."""
    runs = max(1, round(hours * 3600.0 / DURATION / len(GRADES) / len(HONEST)))
    print(closed_loop.head_of(["inertial sensors", "satellites", "hours", "false alarms"]))
    with ProcessPoolExecutor(workers) as pool:
        for grade in GRADES:
            keys = [*base, f"route.duration={DURATION}", f"imu.grade={grade}"]
            for name, (scenario, _) in rows_of(keys).items():
                if name in HONEST:
                    found = sum(pool.map(partial(alarms, scenario), range(runs)))
                    each = f"{runs * DURATION / 3600.0:.0f}"
                    print(closed_loop.line_of([grade, name, each, str(found)]), flush=True)


def main() -> None:
    """Run it."""
    options = closed_loop.parser(__doc__, "data", "page", "rows", "workers", runs=8)
    options.add_argument("--seed", type=int, default=20262)
    options.add_argument("--false-alarms", type=float, metavar="HOURS")
    asked = options.parse_args()
    source = f"map.source={asked.data / AUSTRALIA}"
    if asked.false_alarms is not None:
        count_alarms([source, f"seed={asked.seed}"], asked.false_alarms, asked.workers)
        return
    lines = [closed_loop.head_of(["inertial sensors", "satellites", *COLUMNS])]
    print(lines[0], flush=True)
    deceived = found_out = 0
    with ProcessPoolExecutor(asked.workers) as pool:
        for grade in GRADES:
            base = [
                source,
                f"seed={asked.seed}",
                f"route.duration={DURATION}",
                f"imu.grade={grade}",
            ]
            rows = {
                name: row
                for name, row in rows_of(base).items()
                if closed_loop.containing(f"{grade}, {name}", asked.rows)
            }
            if not rows:
                continue
            alone = row_of(load_scenario(None, base), 0.0, asked.runs, pool)["end"]
            for name, (scenario, start) in rows.items():
                found = {**row_of(scenario, start, asked.runs, pool), "without": alone}
                cells = closed_loop.cells_of(found, COLUMNS)
                lines.append(closed_loop.line_of([grade, name, *cells]))
                print(lines[-1], flush=True)
                if name not in (*HONEST, *SLOW):
                    deceived += asked.runs
                    found_out += int(found["found"])
    text = f"{asked.runs} runs a row.\n\n" + "\n".join(lines)
    text += (
        f"\n\nOf {deceived} runs that were deceived by 1 m/s or more, or at once,"
        f" {deceived - found_out} were not found."
    )
    closed_loop.write_between(asked.page, MARKS, text, seed=asked.seed)


if __name__ == "__main__":
    main()
