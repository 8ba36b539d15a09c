"""Accuracy, speed and start beside the last committed figures, with their ratio: `make bench`.

    python benchmarks/bench.py [--keep] [--json]

Small closed loops, so that a loss is seen in a minute: 8 runs of 1.5 h of the synthetic
scenario. Their errors depend on seed and code only. Times are CPU times with one
thread, divided by those of a fixed amount of NumPy work (`yardstick`), so that figures of two
machines can be compared, roughly. --keep writes benchmarks/figures.json anew: commit it with the
change that has moved the figures, and say there why. Exits with 1 where a ratio is out of its
bounds."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from isogal.evaluation.judgement import all_scans_nees
from isogal.fields.scenario_map import map_for_scenario
from isogal.files import write_atomic
from isogal.montecarlo.engine import simulate
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory

KEPT = Path(__file__).with_name("figures.json")
RUNS, DURATION = 8, 5400.0
WORLD = ["gravity.field=normal", f"route.duration={DURATION}"]
CASES = {
    "pmht, nothing told": [],
    "pmht, map exact, batches apart": ["matcher.map_sigma=0", "matcher.stride=30"],
    "pmht-paper": ["matcher.name=pmht-paper"],
    "disturbance, pmht, map error told": [
        *("gravimeter.quantity=disturbance", "gravimeter.sigma=1e-6"),
        *("map_error.sigma=3e-5", "matcher.map_sigma=3e-5", "matcher.stride=30"),
    ],
}
BOUNDS = {"rms_m": (0.95, 1.05), "nees": (0.8, 1.25), "cpu": (0.0, 1.35)}
"""Of the ratio to the kept figure; of what is not named here, (0, 1.5)."""


def cpu_seconds(work: Callable[[], object], times: int = 5) -> float:
    """Return the least CPU time of several calls."""
    found = []
    for _ in range(times):
        start = time.process_time()
        work()
        found.append(time.process_time() - start)
    return min(found)


def yardstick() -> float:
    """Return the CPU time of the same NumPy work every time, s."""
    matrix = np.random.default_rng(0).standard_normal((160, 160))
    values = np.linspace(0.0, 1.0, 200_000)

    def work() -> None:
        for _ in range(4):
            np.linalg.inv(matrix @ matrix)
            np.sort(np.sin(values * 37.0))

    return cpu_seconds(work, 9)


def closed_loop(settings: list[str], unit: float) -> dict[str, float]:
    """Return error, NEES and times of a case."""
    scenario = load_scenario(None, [*WORLD, *settings])
    field_map = map_for_scenario(scenario, build_trajectory(scenario))
    simulate(scenario, [0], field_map)  # compiles
    start = time.process_time()
    runs = simulate(scenario, range(RUNS), field_map)
    seconds = time.process_time() - start
    late = runs.elapsed > 0.5 * DURATION
    return {
        "rms_m": float(np.sqrt(np.mean(runs.horizontal_error[:, late] ** 2))),
        "nees": float(np.nanmean(all_scans_nees(runs))),
        "cpu": seconds / (RUNS * DURATION / 3600.0) / unit,
    }


def start_times() -> dict[str, float]:
    """Return how much more CPU time than a bare interpreter two commands take."""

    def took(*words: str) -> float:
        times = []
        for _ in range(7):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            times.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
        return min(times)

    isogal = str(Path(sys.executable).with_name("isogal"))
    bare = took(sys.executable, "-c", "pass")
    engine = took(sys.executable, "-c", "import isogal.montecarlo.engine")
    return {"help": took(isogal, "--help") / bare, "import of the engine": engine / bare}


def measure() -> dict[str, dict[str, float]]:
    """Return all figures by case."""
    unit = yardstick()
    found = {name: closed_loop(settings, unit) for name, settings in CASES.items()}
    return found | {"start": start_times()}


def compared(now: dict[str, Any], kept: dict[str, Any]) -> tuple[list[str], bool]:
    """Return the lines of the table, and whether all ratios are within their bounds."""
    lines = [f"{'':36}{'figure':24}{'kept':>10}{'now':>10}{'ratio':>8}"]
    good = True
    for case, figures in now.items():
        for name, value in figures.items():
            before = kept.get(case, {}).get(name)
            ratio = value / before if before else float("nan")
            low, high = BOUNDS.get(name, (0.0, 1.5))
            out = before is not None and not low <= ratio <= high
            good &= not out
            was = "–" if before is None else f"{before:.4g}"
            mark = "  OUT" if out else ""
            lines.append(f"{case:36}{name:24}{was:>10}{value:>10.4g}{ratio:>8.3f}{mark}")
    return lines, good


def main() -> None:
    """Measure, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", action="store_true", help="write benchmarks/figures.json")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    now = measure()
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    lines, good = compared(now, kept)
    print(json.dumps(now, indent=2) if options.json else "\n".join(lines))
    if options.keep:
        write_atomic(KEPT, json.dumps(now, indent=2) + "\n")
    elif not good:
        sys.exit(1)


if __name__ == "__main__":
    main()
