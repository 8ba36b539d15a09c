"""How much navigation a second of CPU time buys: Isogal's Monte Carlo beside filterpy's filter and
Stone Soup's PMHT, in one call.

    python benchmarks/montecarlo.py [--runs 8] [--matcher pmht-paper] [--json]

Isogal runs the default scenario in closed loop (all runs and all 3.6 h). filterpy's
UnscentedKalmanFilter navigates the first minutes of run 0: the same 15 states, the same IMU
readings, Isogal's strapdown step as fx, the known height as measurement. Stone Soup's PMHTTracker
matches batches of run 0: the same scans, candidates and prior, as many iterations. Both results
are checked against Isogal's before they are timed, so the same work is compared. Times are CPU
times of this process with one thread; rates are extrapolated to an hour of one run.

Stone Soup is not a dependency: pip install -r benchmarks/requirements.txt. Without it that part is
left out, and said so."""

import json
from importlib.util import find_spec

import closed_loop
from comparison.closed_loop import measure_closed_loop
from comparison.filterpy_filter import measure_filters

from isogal.fields.scenario_map import map_for_scenario
from isogal.montecarlo import engine
from isogal.scenario import validate_scenario
from isogal.sensors.trajectory import build_trajectory

HOUR = 3600.0
Result = dict[str, str | float | dict[str, float | dict[str, float]]]


def measure(runs: int, matcher: str) -> Result:
    """Measure everything; all rates are run-hours of navigation per CPU second."""
    scenario = validate_scenario({"matcher": {"name": matcher}})
    trajectory = build_trajectory(scenario)
    field_map = map_for_scenario(scenario, trajectory)
    duration = float(trajectory.time[-1])
    warm = validate_scenario(
        {"matcher": {"name": matcher, "batch_length": 30}, "route": {"duration": 600.0}}
    )
    engine.simulate(warm, [0], field_map)  # compiles
    seconds, batches = measure_closed_loop(scenario, field_map, runs)
    hours = runs * duration / HOUR
    filters = measure_filters(scenario)
    batch = scenario.matcher.batch_length * scenario.gravimeter.interval
    result: Result = {
        "matcher": matcher,
        "runs": runs,
        "run_hours": hours,
        "closed_loop": {
            "run_hours_per_cpu_second": hours / seconds["all"],
            "share": {
                part: seconds[part] / seconds["all"]
                for part in ("strapdown", "filter", "matching")
            },
            "share_strapdown_in_filter": filters["strapdown_in_filter"] / filters["isogal"],
        },
        "filter": {
            "isogal": 1.0 / (HOUR * filters["isogal"]),
            "filterpy": 1.0 / (HOUR * filters["filterpy"]),
            "ratio": filters["filterpy"] / filters["isogal"],
            "apart_m": filters["apart_m"],
        },
        "closed_loop_over_filterpy_filter": HOUR * filters["filterpy"] * hours / seconds["all"],
    }
    if find_spec("stonesoup") is not None:
        from comparison.stonesoup_pmht import measure_matching

        soup = measure_matching(batches, field_map)
        result["matching"] = {
            "isogal": batch / HOUR / soup["isogal"],
            "stonesoup": batch / HOUR / soup["stonesoup"],
            "ratio": soup["stonesoup"] / soup["isogal"],
            "apart_m": soup["apart_m"],
        }
        result["closed_loop_over_stonesoup_matching"] = (
            hours / seconds["all"] * HOUR / batch * soup["stonesoup"]
        )
    return result


def show(result: Result) -> None:
    """Print rates, and what the others' are beside them."""
    loop, filters, matching = result["closed_loop"], result["filter"], result.get("matching")
    rows = [
        [
            f"closed loop with {result['matcher']}",
            f"{loop['run_hours_per_cpu_second']:.2f}",
            "",
            "",
        ],
        ["filter alone, beside filterpy's", *_beside(filters, "filterpy")],
    ]
    if matching is not None:
        rows.append(["PMHT alone, beside Stone Soup's", *_beside(matching, "stonesoup")])
    print(f"Run-hours of navigation per CPU second, one core, {result['runs']} runs:\n")
    print(closed_loop.markdown(("", "Isogal", "the other", "ratio"), rows))
    parts = [f"{part} {share:.0%}" for part, share in loop["share"].items()]
    over = {name: x for name, x in result.items() if name.startswith("closed_loop_over_")}
    parts += [f"{name.replace('_', ' ')} {x:.0f} times" for name, x in over.items()]
    print(f"\nClosed loop: {', '.join(parts)}; sigma points' strapdown"
          f" {loop['share_strapdown_in_filter']:.0%} of the filter.")  # fmt: skip
    print(f"Checked: filterpy's filter ends {filters['apart_m']:.2g} m from ours", end="")
    if matching is None:
        print("; Stone Soup is not installed (pip install -r benchmarks/requirements.txt).")
    else:
        print(
            f"; Stone Soup's fixes are {matching['apart_m']:.0f} m from ours (median; it has one"
            " covariance for all candidates)."
        )


def _beside(rates: dict[str, float], other: str) -> list[str]:
    return [f"{rates['isogal']:.1f}", f"{rates[other]:.4f}", f"{rates['ratio']:.0f}"]


def main() -> None:
    parser = closed_loop.parser(__doc__, "json", runs=8)
    parser.add_argument("--matcher", default="pmht-paper")
    arguments = parser.parse_args()
    result = measure(arguments.runs, arguments.matcher)
    if arguments.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)


if __name__ == "__main__":
    main()
