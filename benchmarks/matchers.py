"""All matchers on the same runs, in one call: error against the bound, NEES, time per fix.

    python benchmarks/matchers.py [--runs 8] [--map FILE] [--figure docs/figures/matchers.png]
    [--json]

Each case is a closed loop over the default route: the same seeds, so the same sensors, noise and
map errors for every matcher. Errors are after the first hour, as ratios of RMS to the RMS of the
posterior Cramér-Rao bound of the same case; time is the median over fixes, on one thread, and as a
ratio to `pmht`, since absolute times are this machine's."""

import os

from isogal.threads import VARIABLES

os.environ.update(dict.fromkeys(VARIABLES, "1"))  # read when NumPy is imported

import argparse
import json
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from isogal import plugins
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.figures import style
from isogal.evaluation.records import Runs
from isogal.evaluation.summary import summarise
from isogal.fields.scenario_map import map_for_scenario
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import build_trajectory

MATCHERS = plugins.names(plugins.MATCHERS)
EXACT = ["matcher.map_sigma=0"]
CASES: dict[str, list[str]] = {
    "gravity 1 mGal, map exact": ["gravimeter.sigma=1e-5", *EXACT],
    "gravity 20 mGal, map exact": ["gravimeter.sigma=2e-4", *EXACT],
    "disturbance 0.1 mGal, map exact": [
        "gravimeter.quantity=disturbance",
        "gravimeter.sigma=1e-6",
        *EXACT,
    ],
    "gravity 1 mGal, map error 3 mGal": [
        "gravimeter.sigma=1e-5",
        "map_error.sigma=3e-5",
        "matcher.map_sigma=3e-5",
    ],
    "gravity 1 mGal, map error 8 mGal": [
        "gravimeter.sigma=1e-5",
        "map_error.sigma=8e-5",
        "matcher.map_sigma=8e-5",
    ],
}


def measure(scenario: Scenario, runs: int) -> dict[str, float]:
    """Run one matcher on one case."""
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    simulate(scenario, range(1), field_map)  # compiled before anything is timed
    record: Runs = simulate(scenario, range(runs), field_map)
    bound = posterior_cramer_rao(scenario, trajectory, field_map)
    summary = summarise(record, scenario, bound.rms_at(record.time), wall_seconds=0.0)
    return {
        "ratio": summary["position_error"]["rms_after_1h"] / summary["bound"]["rms_after_1h"],
        "rms_after_1h_m": summary["position_error"]["rms_after_1h"],
        "bound_after_1h_m": summary["bound"]["rms_after_1h"],
        "unaided_rms_m": summary["unaided"]["rms"],
        "nees_per_axis": summary["nees_per_axis"]["mean"],
        "diverged": summary["diverged"],
        "declined": summary["fixes"]["declined"],
        "fix_ms": float(np.median(record.fix_seconds)) * 1e3,
    }


@style.journal
def draw(results: dict[str, dict[str, dict[str, float]]]) -> Figure:
    """Error ratio against time per fix, one panel a case."""
    names = list(results)
    rows = -(-len(names) // 2)
    figure = style.new_figure(2.4 * rows)
    axes = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False).ravel()
    markers = dict(zip(MATCHERS, cycle("so^vD<>P"), strict=False))
    for ax, case in zip(axes, names, strict=False):
        for name, row in results[case].items():
            colour = "black" if name == "pmht" else "0.55"
            ax.plot(
                row["fix_ms"],
                row["ratio"],
                markers[name],
                color=colour,
                markersize=5,
                linestyle="none",
            )
            ax.annotate(
                name,
                (row["fix_ms"], row["ratio"]),
                xytext=(5, 3),
                textcoords="offset points",
                fontsize=7,
            )
        ax.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
        ax.set(xscale="log", yscale="log", title=case)
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    figure.supxlabel("median time per fix (ms)")
    figure.supylabel("RMS error after 1 h / bound")
    return figure


def main() -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--map", help="map file; default: the synthetic map")
    parser.add_argument("--batch-length", type=int, default=30)
    parser.add_argument("--matchers", nargs="+", default=list(MATCHERS), choices=list(MATCHERS))
    parser.add_argument(
        "--cases",
        nargs="+",
        type=int,
        default=list(range(len(CASES))),
        help="indices of the cases",
    )
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    results: dict[str, dict[str, Any]] = {}
    for index in arguments.cases:
        case, settings = list(CASES.items())[index]
        results[case] = {}
        if not arguments.json:
            print(
                f"\n{case}\n{'matcher':12} {'RMS/bound':>9} {'RMS m':>8} {'NEES':>9} {'div.':>5}"
                f" {'decl.':>6} {'ms':>7} {'ms/pmht':>8}"
            )
        for name in arguments.matchers:
            overrides = [
                *settings,
                f"matcher.name={name}",
                f"matcher.batch_length={arguments.batch_length}",
                f"matcher.stride={arguments.batch_length}",
            ]
            if arguments.map:
                overrides.append(f"map.source={arguments.map}")
            row = results[case][name] = measure(load_scenario(None, overrides), arguments.runs)
            if not arguments.json:
                relative = (
                    row["fix_ms"] / results[case]["pmht"]["fix_ms"]
                    if "pmht" in results[case]
                    else np.nan
                )
                print(
                    f"{name:12} {row['ratio']:9.2f} {row['rms_after_1h_m']:8.1f}"
                    f" {row['nees_per_axis']:9.2f} {row['diverged']:5d} {row['declined']:6d}"
                    f" {row['fix_ms']:7.2f} {relative:8.2f}",
                    flush=True,
                )
    if arguments.json:
        print(json.dumps(results, indent=1))
    if arguments.figure:
        arguments.figure.parent.mkdir(parents=True, exist_ok=True)
        arguments.figure.write_bytes(style.png(draw(results), 150))


if __name__ == "__main__":
    main()
