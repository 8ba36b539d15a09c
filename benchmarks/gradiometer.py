"""A gradiometer whose map, platform and components err, which is specified or not
(docs/evidence/gradiometer.md).

    python benchmarks/gradiometer.py [--runs 16] [--first 0] [--case TEXT ...] [--out DIR]

Ratio is the RMS error of all scans after the first half hour over the RMS bound of that world at
the same scans, for a navigator that learns at the ends of batches."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
import json
from pathlib import Path

import numpy as np

from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.consistency import nees_per_axis
from isogal.fields.scenario_map import map_for_scenario
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory

BASE = (
    "field=gradient",
    "gradiometer.sigma_eotvos=2",
    "gravity.field=normal",
    "route.duration=7200",
    "matcher.batch_length=15",
    "map_error.sigma=5e-9",
    "map_error.correlation_length=1000",
    "matcher.map_sigma=5e-9",
    "matcher.map_correlation_length=1000",
)
POTENTIAL = ("map_errors=one_potential",)
TILT = ("platform_tilt=5e-3", "platform_time=3600")
LESS = ("platform_tilt=1e-3", "platform_time=3600")
FIXED = ("platform_tilt=5e-3", "platform_time=1e9")
FAR = ("platform_tilt=2e-2", "platform_time=1e9")
FAST = ("platform_tilt=1e-3", "platform_time=200")
OFFSET = ("bias_eotvos=5",)
WALK = ("bias_walk_eotvos=0.1",)
CASES = {
    "nothing more": ((), ()),
    "map errors of one potential": (POTENTIAL, ()),
    "platform tilted by 1 mrad, over an hour": (LESS, POTENTIAL),
    "the same, over 200 s": (FAST, POTENTIAL),
    "platform tilted by 5 mrad, for good": (FIXED, POTENTIAL),
    "the same, over an hour": (TILT, POTENTIAL),
    "platform tilted by 20 mrad, for good": (FAR, POTENTIAL),
    "offsets of 5 E": (OFFSET, POTENTIAL),
    "offsets that walk, 6 E in an hour": (WALK, POTENTIAL),
    "all, and 1 mrad over an hour": ((*LESS, *OFFSET, *WALK), POTENTIAL),
}
"""Keys of the gradiometer that are told or not, and keys that are told in any case."""
_SETTLED = 1800.0


def study(scenario: Scenario, runs: range) -> dict[str, float]:
    """Return RMS error (m), bound and NEES of some runs."""
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    found = simulate(scenario, runs, field_map)
    bound = posterior_cramer_rao(scenario, trajectory, field_map, batchwise=True)
    late = found.time > _SETTLED
    error, covariance = found.error[:, late], found.covariance[:, late]
    limit = float(np.sqrt((bound.rms_at(found.time[late]) ** 2).mean()))
    squared = (error**2).sum(axis=-1).mean(axis=1)
    rms = float(np.sqrt(squared.mean()))
    return {
        "rms": rms,
        "bound": limit,
        "ratio": rms / limit,
        "ratio_error": float(squared.std() / np.sqrt(len(squared)) / (2.0 * rms) / limit),
        "nees_all_scans": float(np.mean(nees_per_axis(found.error, found.covariance))),
        "nees": float(np.mean(nees_per_axis(error, covariance))),
        "fix_ms": float(1e3 * np.nanmedian(found.fix_seconds)),
    }


def main() -> None:
    """Run all cases and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=16)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--case", action="append", help="of the table, by its beginning")
    parser.add_argument("--out", type=Path, default=Path("out/gradiometer"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    table = {}
    print("| what errs | | RMS, m | bound, m | ratio | NEES | at all scans | ms per fix |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for name, (keys, always) in CASES.items():
        if options.case and not any(name.startswith(one) for one in options.case):
            continue
        known = [f"gradiometer.{key}" for key in always]
        for kind, section in (("told", "gradiometer"), ("untold", "truth.gradiometer")):
            if kind == "untold" and not keys:
                continue
            items = [*BASE, *known, *(f"{section}.{key}" for key in keys)]
            runs = range(options.first, options.first + options.runs)
            table[f"{name}, {kind}"] = one = study(load_scenario(None, items), runs)
            print(
                f"| {name} | {kind} | {one['rms']:.1f} | {one['bound']:.1f}"
                f" | {one['ratio']:.2f} ± {one['ratio_error']:.2f} | {one['nees']:.2f}"
                f" | {one['nees_all_scans']:.2f} | {one['fix_ms']:.0f} |",
                flush=True,
            )
            (options.out / "results.json").write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
