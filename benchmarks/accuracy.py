"""The default matcher against the bound, case by case: maps in error, wrong assumptions, wide and
hidden starts, outliers, turns.

    python benchmarks/accuracy.py [--runs 100] [--map FILE] [--batch-lengths 30 15] [--cases NAME
    ...] [--seed 0] [--out FILE.json]

A case is a closed loop of so many runs (3.6 h; wide starts 1 h, hidden ones 1.5 h, or 2 h with a
wrong map). `ratio` is RMS error over RMS bound, both over the time after the first hour; `batch`
is what the ratio would be for a navigator at the bound that learns of readings at batch ends only.
Where a case was run told and with nothing told, the last lines are the one RMS over the other, of
the same runs. Cases that are in FILE.json already are not computed again."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.judgement import SETTLED_AFTER
from isogal.evaluation.records import Runs
from isogal.evaluation.summary import summarise
from isogal.fields.scenario_map import map_for_scenario
from isogal.files import write_atomic
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory

FOUND_WITHIN, FOUND = 2700.0, 500.0
"""s and m: a start is found when the error is below the latter at the former."""
GRAVITY, DISTURBANCE = ["gravimeter.quantity=gravity"], ["gravimeter.quantity=disturbance"]
EXACT = ["matcher.map_sigma=0"]
TOLD_3 = ["map_error.sigma=3e-5", "matcher.map_sigma=3e-5"]
TOLD_8 = ["map_error.sigma=8e-5", "matcher.map_sigma=8e-5"]
BIASED = ["gravimeter.bias=5e-5", "gravimeter.drift=2.8e-9"]
"""5 mGal and 1 mGal per hour, 1-sigma."""
ROWS = {
    "ga 1e-5": [*GRAVITY, "gravimeter.sigma=1e-5"],
    "ga 2e-4": [*GRAVITY, "gravimeter.sigma=2e-4"],
    "dg 1e-6": [*DISTURBANCE, "gravimeter.sigma=1e-6"],
    "dg 4e-5": [*DISTURBANCE, "gravimeter.sigma=4e-5"],
}
GOOD = ROWS["ga 1e-5"]
TURNS = (
    "route.waypoints=[[-37.9, 144.8, 22], [-37.6, 145.2, 18], [-37.75, 145.7, 25],"
    " [-37.3, 146.0, 22], [-37.35, 146.6, 20], [-36.9, 147.2, 22]]"
)


def _hidden(kilometres: int, duration: int) -> list[str]:
    """Return the settings of a hidden start."""
    return [
        f"initial_error.hidden_position={1000 * kilometres}",
        f"route.duration={duration}",
    ]


CASES: dict[str, list[str]] = (
    {f"{name} exact": [*settings, *EXACT] for name, settings in ROWS.items()}
    | {f"{name} 3 mGal": [*settings, *TOLD_3] for name, settings in ROWS.items()}
    | {f"{name} 8 mGal": [*settings, *TOLD_8] for name, settings in ROWS.items()}
    | {
        f"{name} {error}{known}": [*settings, *told]
        for name, settings in ROWS.items()
        for error, wrong, assumed in (
            ("exact", [], EXACT),
            ("3 mGal", ["map_error.sigma=3e-5"], TOLD_3),
            ("8 mGal", ["map_error.sigma=8e-5"], TOLD_8),
        )
        for known, told in ((", nothing told", wrong), (", told, default stride", assumed))
    }
    | {
        "ga 1e-5 3 mGal, sigma x 2": [*GOOD, "map_error.sigma=3e-5", "matcher.map_sigma=6e-5"],
        "ga 1e-5 3 mGal, sigma / 2": [*GOOD, "map_error.sigma=3e-5", "matcher.map_sigma=1.5e-5"],
        "ga 1e-5 3 mGal, L x 2": [*GOOD, *TOLD_3, "matcher.map_correlation_length=8000"],
        "ga 1e-5 3 mGal, L / 2": [*GOOD, *TOLD_3, "matcher.map_correlation_length=2000"],
        "ga 1e-5 3 mGal, auto": [*GOOD, "map_error.sigma=3e-5", "matcher.map_sigma=auto"],
        "dg 1e-6 3 mGal, auto": [
            *ROWS["dg 1e-6"],
            "map_error.sigma=3e-5",
            "matcher.map_sigma=auto",
        ],
        "ga 1e-5, 5 % outliers": [*GOOD, *EXACT, "gravimeter.outlier_fraction=0.05"],
        "ga 1e-5 3 mGal, stride 5": [*GOOD, *TOLD_3, "matcher.stride=5"],
        "ga 1e-5 exact, stride 5": [*GOOD, *EXACT, "matcher.stride=5"],
        "dg 1e-6 exact, stride 5": [*ROWS["dg 1e-6"], *EXACT, "matcher.stride=5"],
        "ga 1e-5, bias told": [*GOOD, *EXACT, *BIASED, "matcher.bias_sigma=5e-5"],
        "ga 1e-5, bias untold": [*GOOD, *EXACT, *BIASED],
        "ga 1e-5, bias, auto": [*GOOD, *BIASED, "matcher.map_sigma=auto"],
        "ga 1e-5 3 mGal, bias told": [*GOOD, *TOLD_3, *BIASED, "matcher.bias_sigma=5e-5"],
        "ga 1e-5 3 mGal, bias untold": [*GOOD, *TOLD_3, *BIASED],
        "ga 1e-5 3 mGal, bias, auto": [
            *GOOD,
            *BIASED,
            "map_error.sigma=3e-5",
            "matcher.map_sigma=auto",
        ],
        "ga 1e-5, turns": [*GOOD, *EXACT, TURNS],
        "ga 1e-5, turns, pmht-paper": [*GOOD, TURNS, "matcher.name=pmht-paper"],
        "start 10 km": [*GOOD, *EXACT, "initial_error.position=10000", "route.duration=3600"],
        "start 10 km, 3 mGal": [
            *GOOD,
            *TOLD_3,
            "initial_error.position=10000",
            "route.duration=3600",
        ],
        "hidden 5 km": [*GOOD, *EXACT, *_hidden(5, 5400)],
        "hidden 5 km, nothing told": [*GOOD, *_hidden(5, 5400)],
        "hidden 5 km, 3 mGal, nothing told": [
            *GOOD,
            "map_error.sigma=3e-5",
            *_hidden(5, 7200),
        ],
        "hidden 10 km": [*GOOD, *EXACT, *_hidden(10, 5400)],
        "hidden 10 km, nothing told": [*GOOD, *_hidden(10, 5400)],
        "hidden 10 km, 3 mGal, nothing told": [
            *GOOD,
            "map_error.sigma=3e-5",
            *_hidden(10, 7200),
        ],
        "hidden 20 km": [*GOOD, *EXACT, *_hidden(20, 5400)],
        "hidden 20 km, nothing told": [*GOOD, *_hidden(20, 5400)],
        "hidden 20 km, 3 mGal, nothing told": [
            *GOOD,
            "map_error.sigma=3e-5",
            *_hidden(20, 7200),
        ],
        "hidden 5 km, 3 mGal": [
            *GOOD,
            *TOLD_3,
            "initial_error.hidden_position=5000",
            "route.duration=7200",
        ],
        "hidden 10 km, 3 mGal": [
            *GOOD,
            *TOLD_3,
            "initial_error.hidden_position=10000",
            "route.duration=7200",
        ],
        "hidden 20 km, 3 mGal": [
            *GOOD,
            *TOLD_3,
            "initial_error.hidden_position=20000",
            "route.duration=7200",
        ],
    }
)
CHUNK = 10
"""Runs to a job."""


TOLD, UNTOLD = ", told, default stride", ", nothing told"
"""Ends of the names of cases that differ in that alone."""


@dataclass(frozen=True)
class Setting:
    """What all cases of a study have in common."""

    batch_length: int
    map_file: str | None
    seed: int

    @property
    def name(self) -> str:
        """For the names of kept results."""
        where = Path(self.map_file).name if self.map_file else "synthetic"
        return f"T = {self.batch_length}, {where}" + (f", seed {self.seed}" if self.seed else "")


def scenario_of(case: str, common: Setting) -> Scenario:
    length, map_file = common.batch_length, common.map_file
    settings = [*CASES[case], f"matcher.batch_length={length}", f"seed={common.seed}"]
    default = "nothing told" in case or "default stride" in case
    if not default and not any("stride" in item for item in settings):
        settings.append(f"matcher.stride={length}")  # batches do not overlap
    return load_scenario(None, [*settings, f"map.source={map_file}"] if map_file else settings)


def some_runs(case: str, common: Setting, runs: range) -> Runs:
    scenario = scenario_of(case, common)
    trajectory = build_trajectory(scenario)
    return simulate(scenario, runs, map_for_scenario(scenario, trajectory))


def measure(case: str, common: Setting, runs: int, pool: ProcessPoolExecutor) -> dict[str, Any]:
    """Run one case."""
    scenario = scenario_of(case, common)
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    parts = [range(first, min(first + CHUNK, runs)) for first in range(0, runs, CHUNK)]
    jobs = [pool.submit(some_runs, case, common, part) for part in parts]
    record = Runs.concatenate([job.result() for job in jobs])
    bound, batch = (
        posterior_cramer_rao(scenario, trajectory, field_map, batchwise=batchwise).rms_at(
            record.time
        )
        for batchwise in (False, True)
    )
    summary = summarise(record, scenario, bound, wall_seconds=0.0)
    row = {
        "runs": runs,
        "diverged": summary["diverged"],
        "declined": summary["fixes"]["declined"],
        "nees_per_axis": summary["nees_per_axis"]["mean"],
        "fix_ms": float(np.median(record.fix_seconds)) * 1e3,
        "slowest_fix_ms": float(np.max(record.fix_seconds)) * 1e3,
        "mean_m": summary["position_error"]["mean"],
    }
    error = record.horizontal_error
    if record.elapsed[-1] > SETTLED_AFTER:
        late = record.elapsed >= SETTLED_AFTER
        of_run = np.sqrt((error[:, late] ** 2).mean(axis=1))
        rms, limit = float(np.sqrt((of_run**2).mean())), float(np.sqrt((bound[late] ** 2).mean()))
        row |= {
            "rms_after_1h_m": rms,
            "bound_after_1h_m": limit,
            "ratio": rms / limit,
            "ratio_error": float(np.std(of_run**2) / np.sqrt(runs) / (2.0 * rms) / limit),
            "batch": float(np.sqrt((batch[late] ** 2).mean())) / limit,
        }
    if "start" in case or "hidden" in case:
        outside = error > FOUND
        last = np.array([np.flatnonzero(far)[-1] if far.any() else -1 for far in outside])
        when = record.elapsed[np.minimum(last + 1, len(record.elapsed) - 1)]
        row |= {
            "found_at_45_min": float(
                (error[:, np.searchsorted(record.elapsed, FOUND_WITHIN)] < FOUND).mean()
            ),
            "found_at_end": float((error[:, -1] < FOUND).mean()),
            "found_median_min": float(np.median(when)) / 60.0,
            "found_last_min": float(when.max()) / 60.0,
        }
    return row


def text_of(case: str, length: int, row: dict[str, Any]) -> str:
    """One line of the table."""
    line = f"{case:30} T={length:<3} {row['runs']:4d} runs  "
    if "found_at_end" in row:
        return (
            line + f"found at 45 min {100 * row['found_at_45_min']:.0f} %, at the end"
            f" {100 * row['found_at_end']:.0f} %; median {row['found_median_min']:.0f} min, last"
            f" {row['found_last_min']:.0f} min; {row['fix_ms']:.1f} ms, slowest fix"
            f" {row['slowest_fix_ms']:.0f} ms"
        )
    return (
        line + f"{row['rms_after_1h_m']:7.1f} m  bound {row['bound_after_1h_m']:6.1f}  ratio"
        f" {row['ratio']:.3f} ± {row['ratio_error']:.3f} (batch {row['batch']:.3f})  NEES"
        f" {row['nees_per_axis']:.2f}  diverged {row['diverged']}  declined {row['declined']} "
        f" {row['fix_ms']:.1f} ms"
    )


def print_pairs(rows: dict[str, dict[str, Any]]) -> None:
    """Print what it costs that nothing is told."""
    for case, row in rows.items():
        told = rows.get(case.removesuffix(UNTOLD) + TOLD)
        if case.endswith(UNTOLD) and told is not None and "rms_after_1h_m" in row:
            pair = row["rms_after_1h_m"] / told["rms_after_1h_m"]
            print(f"{case.removesuffix(UNTOLD):30} nothing told / told {pair:.3f}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--map", help="map file; default: the synthetic map")
    parser.add_argument("--batch-lengths", type=int, nargs="+", default=[30, 15])
    parser.add_argument(
        "--cases", nargs="+", default=list(CASES), choices=list(CASES), metavar="NAME"
    )
    parser.add_argument("--seed", type=int, default=0, help="of all cases")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="keep results there")
    options = parser.parse_args()
    kept: dict[str, Any] = {}
    if options.out and options.out.exists():
        kept = json.loads(options.out.read_text())
    with ProcessPoolExecutor(options.workers) as pool:
        for length in options.batch_lengths:
            common = Setting(length, options.map, options.seed)
            rows: dict[str, dict[str, Any]] = {}
            for case in options.cases:
                key = f"{case}, {common.name}"
                if kept.get(key, {}).get("runs") != options.runs:
                    kept[key] = measure(case, common, options.runs, pool)
                    if options.out:
                        write_atomic(options.out, json.dumps(kept, indent=1))
                rows[case] = kept[key]
                print(text_of(case, length, rows[case]), flush=True)
            print_pairs(rows)


if __name__ == "__main__":
    main()
