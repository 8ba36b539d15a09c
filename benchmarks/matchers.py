"""All matchers on the same runs, in one call: error against the bound, NEES, time per fix.

    python benchmarks/matchers.py [--runs 8] [--map FILE] [--json]

Each case is a closed loop over the default route: the same seeds, so the same sensors, noise and
map errors for every matcher. Errors are after the first hour, as ratios of RMS to the RMS of the
posterior Cramér-Rao bound of the same case; time is the median over fixes, on one thread, and as a
ratio to `pmht`, since absolute times are this machine's."""

import json

import closed_loop
import numpy as np

from isogal import plugins
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario, load_scenario

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
COLUMNS = {
    "RMS/bound": "{ratio:.2f}",
    "RMS m": "{rms:.1f}",
    "NEES": "{nees:.2f}",
    "div.": "{diverged}",
    "decl.": "{declined}",
    "ms": "{fix_ms:.2f}",
    "ms/pmht": "{fix_ms_over_pmht:.2f}",
}


def measure(scenario: Scenario, runs: int) -> closed_loop.Figures:
    """Run one matcher on one case, in this process."""
    simulate(scenario, range(1))  # compiled before anything is timed
    record = simulate(scenario, range(runs))
    return closed_loop.figures_of(scenario, record, closed_loop.bound_of(scenario, record))


def main() -> None:
    """Measure and print."""
    parser = closed_loop.parser(__doc__, "map", "json", runs=8)
    parser.add_argument("--batch-length", type=int, default=30)
    parser.add_argument("--matchers", nargs="+", default=list(MATCHERS), choices=list(MATCHERS))
    every = list(range(len(CASES)))
    parser.add_argument("--cases", nargs="+", type=int, default=every, help="indices of the cases")
    options = parser.parse_args()
    length, results = options.batch_length, {}
    common = [f"matcher.batch_length={length}", f"matcher.stride={length}"]
    common += [f"map.source={options.map}"] if options.map else []
    for case, settings in [list(CASES.items())[index] for index in options.cases]:
        results[case] = {}
        if not options.json:
            print(f"\n{case}\n\n{closed_loop.head_of(['matcher', *COLUMNS])}")
        for name in options.matchers:
            scenario = load_scenario(None, [*settings, *common, f"matcher.name={name}"])
            row = results[case][name] = measure(scenario, options.runs)
            default = results[case].get("pmht", {"fix_ms": np.nan})
            row["fix_ms_over_pmht"] = row["fix_ms"] / default["fix_ms"]
            if not options.json:
                cells = closed_loop.cells_of(row, COLUMNS)
                print(closed_loop.line_of([name, *cells]), flush=True)
    if options.json:
        print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
